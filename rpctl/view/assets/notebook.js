"use strict";
/* A bar under the scene: play or pause, and a slider over time. */
(() => {
  const $ = (id) => document.getElementById(id);
  const { viewer, duration, show } = player;
  let time = 0, playing = false, before = null;

  function seek(to) {
    time = Math.min(Math.max(to, 0), duration);
    show(time);
    $("slider").value = time;
    $("clock").textContent = `${time.toFixed(1)} / ${duration.toFixed(1)} s`;
  }

  function setPlaying(on) {
    playing = on;
    if (on && time >= duration) seek(0);
    $("play").textContent = on ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  }

  function tick(now) {
    if (playing && before !== null) {
      seek(time + (now - before) / 1000);
      if (time >= duration) setPlaying(false);
    } else if (viewer.needs_render) viewer.render();
    before = now;
    requestAnimationFrame(tick);
  }

  $("slider").max = duration;
  $("slider").addEventListener("input", (event) => { setPlaying(false); seek(+event.target.value); });
  $("play").addEventListener("click", () => setPlaying(!playing));
  // A wheel over the scene scrolls the notebook until someone takes hold of the scene.
  viewer.controls.enableZoom = false;
  $("scene").addEventListener("pointerdown", () => { viewer.controls.enableZoom = true; });
  viewer.controls.addEventListener("change", () => viewer.set_dirty());
  new ResizeObserver(() => viewer.set_3d_pane_size()).observe($("scene"));
  seek(0);
  setPlaying(false);
  requestAnimationFrame(tick);
})();
