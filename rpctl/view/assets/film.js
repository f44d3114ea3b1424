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
    const size = Math.max(11, Math.round(height / 36));
    paint.font = `500 ${size}px system-ui, "Segoe UI", Roboto, "Helvetica Neue", sans-serif`;
    badge(size, height);
    if (stamp) {
      paint.textAlign = "right";
      paint.fillStyle = colour("soft");
      paint.fillText(stamp, width - 1.2 * size, height - 1.2 * size);
    }
    return sheet.toDataURL("image/png");
  }

  /* Say in a corner that something hatched stands in for missing meshes. */
  function badge(size, height) {
    const found = document.querySelector(".badge");
    if (!found) return;
    const x = 1.2 * size, y = height - 1.2 * size;
    paint.save();
    paint.beginPath();
    paint.rect(x, y - 0.8 * size, 2 * size, 0.9 * size);
    paint.clip();
    paint.fillStyle = colour("hatch-back");
    paint.fillRect(x, y - size, 2 * size, 2 * size);
    paint.strokeStyle = colour("hatch");
    paint.lineWidth = size / 9;
    for (let k = -4; k < 12; k++) {
      paint.moveTo(x + 0.3 * size * k, y + 0.2 * size);
      paint.lineTo(x + 0.3 * size * k + 1.2 * size, y - size);
    }
    paint.stroke();
    paint.restore();
    paint.fillStyle = colour("soft");
    paint.textAlign = "left";
    paint.fillText(found.textContent, x + 2.5 * size, y);
  }

  return { photograph };
})();
