"use strict";
/* The page itself, which came packed, takes the place of this one. */
(async () => {
  const packed = document.getElementById("packed").textContent;
  const bytes = Uint8Array.from(atob(packed), (char) => char.charCodeAt(0));
  const page = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const html = await new Response(page).text();
  document.open();
  document.write(html);
  document.close();
})();
