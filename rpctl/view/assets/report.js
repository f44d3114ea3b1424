"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("rpctl-data").textContent);
  const duration = data.duration;
  const PLAY = "M7 4.5v15l13-7.5z", PAUSE = "M6 4.5h4.2v15H6zM13.8 4.5H18v15h-4.2z";
  const FIELD_OF_VIEW = 34; // degrees
  const MARGIN = 0.9; // of the picture that the motion may fill
  const SKIP = 1; // s that an arrow key moves

  const bytes = (text) => Uint8Array.from(atob(text), (char) => char.charCodeAt(0));

  let viewer = null, time = 0, playing = false, speed = 1, last = null;
  let mode = "home", followed = null, trails = [];

  try {
    viewer = new MeshCat.Viewer($("scene"));
    start();
  } catch (error) {
    if (viewer) throw error;
    $("failure").hidden = false;
    document.body.classList.add("flat");
  }
  controls();
  show(0);
  const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  window.rpctl = {
    viewer, duration, seek, play, pause, camera, time: () => time, playing: () => playing,
    ready: viewer !== null,
  };
  if (!still && duration > 0) play(); else pause();
  requestAnimationFrame(tick);

  function start() {
    viewer.set_3d_pane_size = (width, height) => {
      const pane = $("scene");
      width = width || pane.clientWidth;
      height = height || pane.clientHeight;
      if (!width || !height) return;
      viewer.camera.aspect = width / height;
      viewer.camera.updateProjectionMatrix();
      viewer.renderer.setSize(width, height);
      viewer.set_dirty();
    };
    viewer.gui.domElement.remove();
    // One after the other: an animation that comes before its objects moves nothing.
    for (const command of data.commands) viewer.handle_command_bytearray(bytes(command));
    viewer.animator.pause();
    followed = viewer.scene.getObjectByName(data.follow);
    trails = ["trail-base", "trail-tip"]
      .map((name) => viewer.scene.getObjectByName(name))
      .filter((trail) => trail);
    viewer.camera.fov = FIELD_OF_VIEW;
    viewer.controls.addEventListener("start", () => { if (mode !== "follow") press(null); });
    const dark = window.matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", paint);
    paint();
    new ResizeObserver(() => {
      viewer.set_3d_pane_size();
      if (mode === "home" || mode === "top") camera(mode);
    }).observe($("scene"));
    viewer.set_3d_pane_size();
    camera("home");
  }

  /* Give the trails the colours of the page, which differ between light and dark. */
  function paint() {
    const style = getComputedStyle(document.documentElement);
    const trail = (name, colour) => {
      const found = viewer.scene.getObjectByName(`trail-${name}`);
      if (found) found.material.color.set(style.getPropertyValue(`--${colour}`).trim());
    };
    for (const kind of ["base", "tip"]) {
      trail(kind, kind);
      trail(`${kind}-desired`, "desired");
    }
    viewer.set_dirty();
  }

  // ---- time -----------------------------------------------------------------------------

  function tick(now) {
    if (playing && last !== null) {
      const next = time + speed * (now - last) / 1000;
      show(next > duration ? 0 : next);
    }
    last = now;
    requestAnimationFrame(tick);
  }

  function show(t) {
    time = Math.min(Math.max(t, 0), duration);
    $("scrubber").value = time;
    $("scrubber").setAttribute("aria-valuetext", `${time.toFixed(1)} seconds`);
    $("clock").textContent = `${time.toFixed(2)} / ${duration.toFixed(2)} s`;
    if (!viewer) return;
    const before = followed && followed.position.clone();
    viewer.animator.seek(time);
    const share = duration > 0 ? time / duration : 1;
    for (const trail of trails) {
      const corners = trail.geometry.index.count, steps = data.frames - 1;
      trail.geometry.setDrawRange(0, Math.round(corners / steps) * Math.floor(share * steps));
    }
    if (mode === "follow" && before) shift(followed.position.clone().sub(before));
    viewer.set_dirty();
  }

  function seek(t) { show(t); }

  function play() { setPlaying(true); }

  function pause() { setPlaying(false); }

  function setPlaying(on) {
    playing = on;
    $("play-icon").setAttribute("d", on ? PAUSE : PLAY);
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  }

  // ---- camera: the scene is z-up, three.js is y-up ------------------------------------------

  function upright(x, y, z) { return new MeshCat.THREE.Vector3(x, z, -y); }

  function shift(by) {
    const step = upright(by.x, by.y, by.z);
    viewer.camera.position.add(step);
    viewer.controls.target.add(step);
  }

  function camera(name) {
    if (!viewer) return;
    press(name);
    if (name === "follow" && followed) {
      const [low, high] = data.start, from = data.origin, at = followed.position;
      const moved = [at.x - from[0], at.y - from[1], at.z - from[2]];
      const grown = 0.25 * Math.max(...high.map((value, i) => value - low[i]));
      const corners = [...Array(8).keys()].map((k) => [0, 1, 2].map((i) =>
        (k >> i & 1 ? high : low)[i] + moved[i] + (i < 2) * grown * (k >> i & 1 ? 1 : -1)));
      aim(corners, [0.75, -1, 0.55]);
    } else if (name === "top") {
      aim(data.hull, [0, -1e-3, 1]);
    } else {
      aim(data.hull, [0.45, -1, 0.7], [1, 0.45, 0.7]);
    }
  }

  /* Put the camera as near as all points fit into the picture, seen from the best direction. */
  function aim(points, ...directions) {
    const corners = points.map((point) => upright(...point));
    const fits = directions.map((direction) => fit(corners, upright(...direction).normalize()));
    const { eye, back, depth } = fits.reduce((a, b) => (b.depth < a.depth ? b : a));
    viewer.camera.near = depth / 200;
    viewer.camera.far = depth * 50;
    viewer.camera.position.copy(eye);
    viewer.controls.target.copy(eye).addScaledVector(back, -depth);
    viewer.camera.updateProjectionMatrix();
    viewer.controls.update();
    viewer.set_dirty();
  }

  /* With the axes of the camera (right, up, back towards it), a point is in the picture where
     |x - cx| <= t (cz - z), t the tangent of half the field of view; likewise for y. The nearest
     camera then follows from the extremes of x + t z and x - t z. */
  function fit(corners, back) {
    const right = new MeshCat.THREE.Vector3(0, 1, 0).cross(back).normalize();
    const up = back.clone().cross(right);
    const tangent = MARGIN * Math.tan(FIELD_OF_VIEW * Math.PI / 360);
    const span = (axis, t) => {
      const sum = Math.max(...corners.map((c) => c.dot(axis) + t * c.dot(back)));
      const difference = Math.min(...corners.map((c) => c.dot(axis) - t * c.dot(back)));
      return { away: (sum - difference) / (2 * t), middle: (sum + difference) / 2 };
    };
    const across = span(right, tangent * viewer.camera.aspect), along = span(up, tangent);
    const away = Math.max(across.away, along.away);
    const eye = right.multiplyScalar(across.middle)
      .addScaledVector(up, along.middle).addScaledVector(back, away);
    const depths = corners.map((corner) => away - corner.dot(back));
    const depth = Math.max((Math.min(...depths) + Math.max(...depths)) / 2, 0.1);
    return { eye, back, depth };
  }

  function press(name) {
    mode = name;
    for (const each of ["home", "top", "follow"])
      $(`camera-${each}`).setAttribute("aria-pressed", String(each === name));
  }

  // ---- controls ---------------------------------------------------------------------------

  function controls() {
    $("play").addEventListener("click", () => setPlaying(!playing));
    $("scrubber").addEventListener("input", (event) => show(Number(event.target.value)));
    $("speed").addEventListener("change", (event) => { speed = Number(event.target.value); });
    for (const name of ["home", "top", "follow"])
      $(`camera-${name}`).addEventListener("click", () => camera(name));
    window.addEventListener("keydown", (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey) return;
      if (event.target.closest("select, summary, .cameras")) return;
      const moves = {
        " ": () => setPlaying(!playing), ArrowLeft: () => show(time - SKIP),
        ArrowRight: () => show(time + SKIP), Home: () => show(0), End: () => show(duration),
      };
      if (!(event.key in moves)) return;
      event.preventDefault();
      if (event.key === "End") pause();
      moves[event.key]();
    });
  }
})();
