"use strict";
/* One picture at a time, as it goes into a film: ground, scene, and the time in a corner. */
const film = (() => {
  const sheet = document.createElement("canvas");
  const paint = sheet.getContext("2d", { alpha: false });
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();

  function photograph(time, stamp) {
    player.show(time);
    const width = sheet.width = innerWidth, height = sheet.height = innerHeight;
    const sky = paint.createLinearGradient(0, 0, 0, height);
    sky.addColorStop(0, colour("stage-top"));
    sky.addColorStop(1, colour("stage-bottom"));
    paint.fillStyle = sky;
    paint.fillRect(0, 0, width, height);
    paint.imageSmoothingQuality = "high";
    paint.drawImage(player.viewer.renderer.domElement, 0, 0, width, height);
    if (stamp) {
      const size = Math.max(11, Math.round(height / 36));
      paint.font = `500 ${size}px system-ui, "Segoe UI", Roboto, "Helvetica Neue", sans-serif`;
      paint.textAlign = "right";
      paint.fillStyle = colour("soft");
      paint.fillText(stamp, width - 1.2 * size, height - 1.2 * size);
    }
    return sheet.toDataURL("image/png");
  }

  return { photograph };
})();
