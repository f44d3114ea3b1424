/* The scene: meshcat's viewer, with cameras, layers, efforts as colour and the ground's forces. */

const FIELD_OF_VIEW = 34; // degrees

/* Return the scene, or null where the browser cannot draw one. */
function makeScene(data, pane) {
  let viewer, mode = "home", followed = null, trails = [], efforts = null, stance = null;
  try {
    viewer = new MeshCat.Viewer(pane);
  } catch {
    return null;
  }
  start();
  return { viewer, show, paint, camera, layer };

  function start() {
    viewer.set_3d_pane_size = (width, height) => {
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
    trails = data.runs.flatMap(({ prefix, duration, frames }) => ["trail-base", "trail-tip"]
      .map((name) => viewer.scene.getObjectByName(prefix + name))
      .filter((trail) => trail)
      .map((trail) => ({ trail, duration, steps: frames - 1 })));
    if (data.effort) efforts = makeEfforts(viewer, data);
    if (data.stance) stance = makeStance(viewer, data, followed.parent);
    viewer.camera.fov = FIELD_OF_VIEW;
    viewer.controls.addEventListener("start", () => { if (mode !== "follow") press(null); });
    new ResizeObserver(() => {
      viewer.set_3d_pane_size();
      if (mode === "home" || mode === "top") camera(mode);
    }).observe(pane);
    viewer.set_3d_pane_size();
    camera("home");
  }

  /* Give trails and ghosts the colours of the page, which differ between light and dark. */
  function paint() {
    const several = data.runs.length > 1;
    const tint = (name, variable) => {
      const found = viewer.scene.getObjectByName(name);
      if (found) found.material.color.set(css(variable));
    };
    for (const body of ["base", "tip"]) tint(`obstacles-${body}`, `--obstacles-${body}`);
    data.runs.forEach(({ prefix }, k) => {
      for (const kind of ["base", "tip"]) {
        tint(`${prefix}trail-${kind}`, several ? `--c${k % PALETTE}` : `--${kind}`);
        tint(`${prefix}trail-${kind}-desired`, "--desired");
      }
      if (k > 0) viewer.scene.traverse((node) => {
        if (node.name.startsWith(`${prefix}tint-`)) node.material.color.set(css(`--c${k % PALETTE}`));
      });
    });
    viewer.set_dirty();
  }

  function show(time) {
    const before = followed && followed.position.clone();
    viewer.animator.seek(time);
    for (const { trail, duration, steps } of trails) {
      const share = duration > 0 ? Math.min(time / duration, 1) : 1;
      const corners = trail.geometry.index.count;
      trail.geometry.setDrawRange(0, Math.round(corners / steps) * Math.floor(share * steps));
    }
    if (efforts) efforts.show(time);
    if (stance) stance.show(time);
    if (mode === "follow" && before) shift(followed.position.clone().sub(before));
    viewer.set_dirty();
  }

  /* Show or hide what an entry of the legend names. */
  function layer(name, on) {
    if (name === "effort") efforts.turn(on);
    const run = data.runs[Number(name.replace("run-", "")) - 1];
    const own = run ? new RegExp(`^${run.prefix}(robot-|trail-(base|tip)$)`) : {
      base: /^trail-base$/, tip: /^trail-tip$/, desired: /trail-(base|tip)-desired$/,
      ghost: /^reference-/, "stand-in": /^stand-in-/, loads: /^stance-loads$/, zmp: /^stance-polygon$/,
      "obstacles-base": /^obstacles-base$/, "obstacles-tip": /^obstacles-tip$/,
    }[name];
    if (own) viewer.scene.traverse((node) => { if (own.test(node.name)) node.visible = on; });
    viewer.set_dirty();
  }

  // ---- camera --------------------------------------------------------------------------------

  function shift(by) {
    const step = upright(by.x, by.y, by.z);
    viewer.camera.position.add(step);
    viewer.controls.target.add(step);
  }

  function camera(name) {
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
    const { fov, aspect } = viewer.camera;
    const { eye, back, depth } = nearestView(points.map((point) => upright(...point)),
      directions.map((direction) => upright(...direction)), fov, aspect);
    viewer.camera.near = depth / 200;
    viewer.camera.far = depth * 50;
    viewer.camera.position.copy(eye);
    viewer.controls.target.copy(eye).addScaledVector(back, -depth);
    viewer.camera.updateProjectionMatrix();
    viewer.controls.update();
    viewer.set_dirty();
  }

  function press(name) {
    mode = name;
    for (const each of ["home", "top", "follow"])
      document.getElementById(`camera-${each}`).setAttribute("aria-pressed", String(each === name));
  }
}
