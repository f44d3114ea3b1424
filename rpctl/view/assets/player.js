"use strict";
/* The bare scene: no panel and no controls; whoever embeds it draws and moves it. */
const player = (() => {
  const data = JSON.parse(document.getElementById("rpctl-scene").textContent);
  const pane = document.getElementById("scene");
  const bytes = (text) => Uint8Array.from(atob(text), (char) => char.charCodeAt(0));
  const fov = 30; // degrees: long enough a lens that robots keep their shape
  const directions = [[0.45, -1, 0.62], [1, 0.45, 0.62], [-0.45, -1, 0.62], [1, -0.45, 0.62]];

  const viewer = new MeshCat.Viewer(pane, false); // false: it does not draw by itself
  viewer.gui.domElement.remove();
  viewer.set_3d_pane_size = () => {
    viewer.camera.aspect = pane.clientWidth / Math.max(pane.clientHeight, 1);
    viewer.renderer.setSize(pane.clientWidth, pane.clientHeight);
    viewer.render();
  };
  // One after the other: an animation that comes before its objects moves nothing.
  for (const command of data.commands) viewer.handle_command_bytearray(bytes(command));
  viewer.animator.pause();

  const find = (name) => viewer.scene.getObjectByName(name);
  const trails = ["trail-base", "trail-tip"].map(find).filter(Boolean);
  const ghosts = []; // pairs: a joint of the robot, and the same of its reference
  viewer.scene.traverse((node) => {
    if (/^reference-\d+$/.test(node.name))
      ghosts.push([find(node.name.replace("reference", "robot")), node]);
  });

  const { eye, back, depth } = nearestView(data.hull.map((point) => upright(...point)),
    directions.map((direction) => upright(...direction)), fov,
    pane.clientWidth / Math.max(pane.clientHeight, 1));
  Object.assign(viewer.camera, { near: depth / 100, far: 20 * depth, fov });
  viewer.camera.position.copy(eye);
  viewer.controls.target.copy(eye).addScaledVector(back, -depth);
  show(0);
  viewer.set_3d_pane_size();

  /* Draw the scene at a time, s. */
  function show(time) {
    viewer.animator.seek(time);
    const share = data.duration > 0 ? time / data.duration : 1;
    for (const trail of trails) {
      const corners = trail.geometry.index.count, steps = data.frames - 1;
      trail.geometry.setDrawRange(0, Math.round(corners / steps) * Math.floor(share * steps));
    }
    // A ghost that the robot covers costs as much to draw as one that is seen.
    for (const [robot, ghost] of ghosts)
      ghost.visible = robot.position.distanceTo(ghost.position) > data.covered
        || robot.quaternion.angleTo(ghost.quaternion) > data.covered;
    viewer.render();
  }

  return { viewer, duration: data.duration, show };
})();
