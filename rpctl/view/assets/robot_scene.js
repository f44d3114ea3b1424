"use strict";
/* The robot in three dimensions: its pose, its markers, its trail and the camera. */
function makeScene(data) {
  const $ = (id) => document.getElementById(id);
  const { THREE } = MeshCat;
  const FIELD_OF_VIEW = 34; // degrees
  const MARGIN = 0.96; // of the picture that the robot may fill
  const BELOW = 15; // pixels; the name of a contact leaves its arrow free
  const TRAIL = 4000; // points of the trail; beyond, every other one goes

  const viewer = new MeshCat.Viewer($("scene"));
  viewer.gui.domElement.remove();
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
  for (const command of data.commands)
    viewer.handle_command_bytearray(Uint8Array.from(atob(command), (char) => char.charCodeAt(0)));
  viewer.camera.fov = FIELD_OF_VIEW;

  const node = (name) => viewer.scene.getObjectByName(name);
  const skeletons = { robot: bones("robot"), reference: bones("reference") };
  const root = skeletons.robot.root;
  const contacts = data.wheels.map((wheel) => ({ ...wheel, at: node(wheel.node) }));
  const masses = data.masses.map((link) => ({ ...link, at: node(link.node) }));
  const layers = { frame: [], mass: [], contact: [], name: [] };
  const labels = data.labels.map(makeLabel);
  const whole = node("mass-all");
  const trail = makeTrail();
  let mode = null;

  new ResizeObserver(() => { viewer.set_3d_pane_size(); if (mode) camera(mode); }).observe($("scene"));
  viewer.controls.addEventListener("start", () => { if (mode !== "robot") press(null); });
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", colours);
  viewer.set_3d_pane_size();
  colours();
  refresh();

  // ---- pose -----------------------------------------------------------------------------

  function bones(prefix) {
    return {
      root: node(`${prefix}-1`),
      joints: data.joints.map((joint) => ({
        at: node(`${prefix}-${joint.node}`), slides: joint.slides,
        axis: new THREE.Vector3(...joint.axis),
      })),
    };
  }

  /* Put a skeleton at a pose (x, y, heading) of its root link and positions of its joints. */
  function pose(base, values, who = "robot") {
    const { root: trunk, joints } = skeletons[who];
    const before = trunk.position.clone();
    trunk.position.set(base[0], base[1], data.height);
    trunk.rotation.set(0, 0, base[2]);
    joints.forEach(({ at, slides, axis }, i) => {
      if (slides) at.position.copy(axis).multiplyScalar(values[i]);
      else at.quaternion.setFromAxisAngle(axis, values[i]);
    });
    if (who !== "robot") return;
    if (mode === "robot") shift(trunk.position.clone().sub(before));
    if (whole.visible) balance();
    viewer.set_dirty();
  }

  /* Where the wheels meet the ground, in the axes of the root link. */
  function ground() {
    root.updateWorldMatrix(true, false);
    const back = root.matrixWorld.clone().invert();
    return contacts.map(({ at, axle, along, radius }) => {
      at.updateWorldMatrix(true, false);
      const local = back.clone().multiply(at.matrixWorld);
      const turn = (v) => new THREE.Vector3(v[0], v[1], v[2] || 0).transformDirection(local);
      return {
        place: new THREE.Vector3().setFromMatrixPosition(local),
        axle: turn(axle), along: turn(along), radius,
      };
    });
  }

  /* Put the marker of the whole robot's mass at its centre, and its shadow below it. */
  function balance() {
    viewer.scene.updateMatrixWorld();
    const sum = new THREE.Vector3(), place = new THREE.Vector3();
    let total = 0;
    for (const { at, mass } of masses) {
      sum.addScaledVector(place.setFromMatrixPosition(at.matrixWorld), mass);
      total += mass;
    }
    if (!total) return;
    whole.position.copy(whole.parent.worldToLocal(sum.divideScalar(total)));
    node("mass-foot").position.z = data.ground - whole.position.z;
  }

  // ---- markers and labels ---------------------------------------------------------------

  function makeLabel({ node: name, layer, text, rank }) {
    const at = node(name), tag = document.createElement("span");
    tag.textContent = text;
    tag.hidden = true;
    $("labels").append(tag);
    layers[layer].push(at);
    return { at, tag, rank, below: layer === "contact" ? BELOW : 0, place: new THREE.Vector3() };
  }

  function refresh() {
    const shown = (layer) => $(`layer-${layer}`).checked;
    for (const layer of ["frame", "mass", "contact"])
      for (const each of layers[layer]) each.visible = shown(layer);
    if (shown("mass")) balance();
    viewer.set_dirty();
  }

  standIns();
  for (const layer of Object.keys(layers)) $(`layer-${layer}`).addEventListener("change", refresh);

  /* What stands in for missing meshes is shown and hidden together. */
  function standIns() {
    const box = $("layer-stand-in");
    if (!box) return;
    const parts = [];
    skeletons.robot.root.traverse((each) => { if (each.name.startsWith("stand-in-")) parts.push(each); });
    box.addEventListener("change", () => {
      for (const part of parts) part.visible = box.checked;
      viewer.set_dirty();
    });
  }

  /* Write the names beside what they name: by rank, then the nearest, and none over another. */
  function tag() {
    const { clientWidth: width, clientHeight: height } = $("scene");
    const named = $("layer-name").checked;
    viewer.camera.updateMatrixWorld();
    const wanted = [];
    for (const label of labels) {
      label.tag.hidden = true;
      if (!named || !label.at.visible) continue;
      const spot = label.place.setFromMatrixPosition(label.at.matrixWorld).project(viewer.camera);
      if (Math.abs(spot.x) < 1 && Math.abs(spot.y) < 1 && spot.z < 1) wanted.push(label);
    }
    wanted.sort((a, b) => b.rank - a.rank || a.place.z - b.place.z);
    const taken = [];
    for (const { tag: element, place, below } of wanted) {
      element.hidden = false;
      const wide = element.offsetWidth, high = element.offsetHeight;
      const x = Math.min((place.x + 1) / 2 * width + 7, width - wide);
      const y = (1 - place.y) / 2 * height - high / 2 + below;
      const free = taken.every((other) => x > other.x + other.wide || x + wide < other.x
        || y > other.y + other.high || y + high < other.y);
      element.hidden = !free;
      if (free) taken.push({ x, y, wide, high });
      element.style.transform = `translate(${x}px, ${y}px)`;
    }
  }

  const render = viewer.render.bind(viewer);
  viewer.render = () => { render(); tag(); };

  // ---- trail ----------------------------------------------------------------------------

  function makeTrail() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * TRAIL), 3));
    const index = [];
    for (let k = 0; k + 1 < TRAIL; k++)
      index.push(2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 2, 2 * k + 1, 2 * k + 3);
    geometry.setIndex(index);
    geometry.setDrawRange(0, 0);
    const material = new THREE.MeshBasicMaterial({ side: THREE.DoubleSide });
    const mesh = new THREE.Mesh(geometry, material);
    mesh.name = "trail-live";
    mesh.renderOrder = 3;
    mesh.frustumCulled = false;
    root.parent.add(mesh);
    return { mesh, points: [], least: data.trail / 2 };
  }

  /* Lengthen the trail to where P is, for a pose (x, y, heading) of the root link. */
  function extend(base) {
    const [px, py] = data.point, cos = Math.cos(base[2]), sin = Math.sin(base[2]);
    const x = base[0] + cos * px - sin * py, y = base[1] + sin * px + cos * py;
    const { points, mesh } = trail, last = points[points.length - 1];
    if (last && Math.hypot(x - last[0], y - last[1]) < trail.least) return;
    points.push([x, y]);
    if (points.length < TRAIL) return stretch(points.length - 1);
    trail.points = points.filter((_, k) => k % 2 === 0);
    trail.least *= 2;
    mesh.geometry.setDrawRange(0, 0);
    for (let k = 0; k < trail.points.length; k++) stretch(k);
  }

  /* Show or hide a skeleton. */
  function reveal(who, on) {
    skeletons[who].root.visible = on;
    viewer.set_dirty();
  }

  function clear() {
    Object.assign(trail, { points: [], least: data.trail / 2 });
    trail.mesh.geometry.setDrawRange(0, 0);
  }

  function stretch(k) {
    const { points, mesh } = trail, { position } = mesh.geometry.attributes;
    const side = (i, j) => {
      const dx = points[j][0] - points[i][0], dy = points[j][1] - points[i][1];
      const scale = data.trail / 2 / Math.hypot(dx, dy);
      position.setXYZ(2 * j, points[j][0] - scale * dy, points[j][1] + scale * dx, data.ground + 0.003);
      position.setXYZ(2 * j + 1, points[j][0] + scale * dy, points[j][1] - scale * dx, data.ground + 0.003);
      if (j !== 1) return;
      position.setXYZ(0, points[0][0] - scale * dy, points[0][1] + scale * dx, data.ground + 0.003);
      position.setXYZ(1, points[0][0] + scale * dy, points[0][1] - scale * dx, data.ground + 0.003);
    };
    if (k > 0) side(k - 1, k);
    position.needsUpdate = true;
    mesh.geometry.setDrawRange(0, 6 * k);
  }

  function colours() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    trail.mesh.material.color.set(colour("base"));
    const tint = (name, variable) => node(name) && node(name).material.color.set(colour(variable));
    tint("trail-base-desired", "desired");
    for (const body of ["base", "tip"]) tint(`obstacles-${body}`, `obstacles-${body}`);
    viewer.set_dirty();
  }

  // ---- camera: the scene is z-up, three.js is y-up ------------------------------------------

  function upright(x, y, z) { return new THREE.Vector3(x, z, -y); }

  function shift(by) {
    const step = upright(by.x, by.y, by.z);
    viewer.camera.position.add(step);
    viewer.controls.target.add(step);
    viewer.camera.updateMatrixWorld();
  }

  function camera(name) {
    press(name);
    const box = name === "area" || (name === "top" && data.area) ? data.area : around();
    aim(box, name === "top" ? [0, -1e-3, 1] : [0.75, -1, 0.5]);
  }

  /* The box that held the robot at the start, wherever it is now. */
  function around() {
    const at = [root.position.x, root.position.y, 0];
    return data.robot.map((corner) => corner.map((value, i) => value + at[i]));
  }

  /* Look at the middle of a box from as near as all its corners are in the picture. */
  function aim([low, high], direction) {
    const back = upright(...direction).normalize();
    const right = new THREE.Vector3(0, 1, 0).cross(back).normalize(), up = back.clone().cross(right);
    const centre = upright(...low.map((value, i) => (value + high[i]) / 2));
    const t = MARGIN * Math.tan(FIELD_OF_VIEW * Math.PI / 360);
    let distance = 0.1;
    for (let k = 0; k < 8; k++) {
      const corner = upright(...[0, 1, 2].map((i) => (k >> i & 1 ? high : low)[i])).sub(centre);
      const off = Math.max(Math.abs(corner.dot(right)) / viewer.camera.aspect,
        Math.abs(corner.dot(up))) / t;
      distance = Math.max(distance, corner.dot(back) + off);
    }
    viewer.camera.near = distance / 100;
    viewer.camera.far = distance * 50;
    viewer.camera.position.copy(centre).addScaledVector(back, distance);
    viewer.controls.target.copy(centre);
    viewer.camera.updateProjectionMatrix();
    viewer.controls.update();
    viewer.set_dirty();
  }

  /* Look at a box from the side, whatever the robot does. */
  function look(box) {
    press(null);
    aim(box, [0.75, -1, 0.65]);
  }

  function press(name) {
    mode = name;
    for (const each of ["area", "robot", "top"])
      $(`camera-${each}`).setAttribute("aria-pressed", String(each === name));
  }

  for (const each of ["area", "robot", "top"])
    $(`camera-${each}`).addEventListener("click", () => camera(each));
  $("camera-area").hidden = !data.area;
  $("layer-contact").parentElement.hidden = layers.contact.length === 0;

  return { viewer, pose, ground, camera, extend, clear, reveal, look, node };
}
