/* What colours and surrounds the robot while it moves: efforts, and the forces of the ground. */

/* Return what interpolates rows of numbers, one a frame, at a time. */
function sampler(text, width, duration) {
  const rows = floats(text), frames = rows.length / width;
  return (time) => {
    const place = duration > 0 ? Math.min(time / duration, 1) * (frames - 1) : 0;
    const first = Math.min(Math.floor(place), Math.max(frames - 2, 0)), part = place - first;
    const next = Math.min(first + 1, frames - 1);
    return Array.from({ length: width }, (_, i) =>
      (1 - part) * rows[first * width + i] + part * rows[next * width + i]);
  };
}

/* Colour what each joint moves by the share of its limit that its actuator uses. */
function makeEfforts(viewer, { effort, duration }) {
  const mild = new MeshCat.THREE.Color(css("--mild")), full = new MeshCat.THREE.Color(css("--full"));
  const at = sampler(effort.share, effort.joints.length, duration);
  const painted = effort.joints.map((joint) => {
    const group = viewer.scene.getObjectByName(`robot-${joint}`), paints = [];
    if (group) group.traverse((node) => {
      if (!node.material) return;
      node.material = node.material.clone();
      paints.push({ material: node.material, own: node.material.color.clone() });
    });
    return paints;
  });
  let on = false, time = 0; // the page turns it on
  return { show, turn: (wanted) => { on = wanted; show(time); } };

  function show(t) {
    time = t;
    at(t).forEach((share, k) => {
      const hot = mild.clone().lerp(full, Math.min(Math.max(2 * share - 1, 0), 1));
      const part = on ? 0.92 * Math.min(2 * share, 1) : 0;
      for (const { material, own } of painted[k]) material.color.copy(own).lerp(hot, part);
    });
  }
}

/* Draw the forces of the ground, the support polygon and the zero-moment point. */
function makeStance(viewer, data, parent) {
  const { stance, duration } = data, THREE = MeshCat.THREE;
  const [low, high] = data.start.map((corner) => new THREE.Vector3(...corner));
  const size = high.distanceTo(low), thick = 0.012 * size;
  const pose = sampler(stance.pose, 3, duration), zmp = sampler(stance.zmp, 2, duration);
  const margin = sampler(stance.margin, 1, duration);
  const group = new THREE.Group(), ground = new THREE.Group(), loads = new THREE.Group();
  ground.name = "stance-polygon";
  loads.name = "stance-loads";
  group.add(ground, loads);
  parent.add(group);
  const safe = paint(css("--zmp"), 0.9, false), area = paint(css("--zmp"), 0.2);
  const violet = paint(css("--loads"), 0.95, false);
  const corners = stance.polygon.map((k) => new THREE.Vector2(...stance.points[k]));
  const fill = new THREE.Mesh(new THREE.ShapeGeometry(new THREE.Shape(corners)), area);
  ground.add(fill, ...corners.map((a, k) => edge(a, corners[(k + 1) % corners.length])));
  const point = new THREE.Mesh(new THREE.RingGeometry(1.6 * thick, 2.8 * thick, 40), safe);
  const dot = new THREE.Mesh(new THREE.CircleGeometry(0.8 * thick, 24), safe);
  ground.add(point, dot);
  ground.traverse((node) => { node.renderOrder = 6; });
  const force = stance.force && sampler(stance.force, 3 * stance.points.length, duration);
  const arrows = force ? stance.points.map(() => arrow()) : [];
  return { show };

  function paint(color, opacity, hidden = true) {
    return new THREE.MeshBasicMaterial({
      color, opacity, transparent: true, side: THREE.DoubleSide, depthWrite: false,
      depthTest: hidden,
    });
  }

  function edge(a, b) {
    const line = new THREE.Mesh(new THREE.PlaneGeometry(a.distanceTo(b) + 0.5 * thick, 0.5 * thick),
      safe);
    line.position.set((a.x + b.x) / 2, (a.y + b.y) / 2, 0);
    line.rotation.z = Math.atan2(b.y - a.y, b.x - a.x);
    return line;
  }

  /* An arrow of length 1 along y, as three.js makes cylinders; it is seen through the robot. */
  function arrow() {
    const whole = new THREE.Group();
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.45 * thick, 0.45 * thick, 1, 10), violet);
    const tip = new THREE.Mesh(new THREE.ConeGeometry(1.3 * thick, 3.2 * thick, 14), violet);
    whole.add(shaft, tip);
    for (const part of [shaft, tip]) part.renderOrder = 7;
    loads.add(whole);
    return { whole, shaft, tip };
  }

  function show(time) {
    const [x, y, yaw] = pose(time), [px, py] = zmp(time);
    group.position.set(x, y, stance.height + 0.002 * size);
    group.rotation.z = yaw;
    point.position.set(px, py, 0.001 * size);
    dot.position.copy(point.position);
    for (const material of [safe, area]) material.color.set(css(margin(time)[0] < 0 ? "--full" : "--zmp"));
    if (!force) return;
    const rows = force(time), up = new THREE.Vector3(0, 1, 0);
    arrows.forEach(({ whole, shaft, tip }, k) => {
      const push = new THREE.Vector3(...rows.slice(3 * k, 3 * k + 3));
      const length = 0.3 * size * push.length() / stance.largest;
      whole.visible = push.z > 0 && length > 0.5 * thick;
      const head = Math.min(3.2 * thick, 0.6 * length);
      shaft.scale.y = length - head;
      shaft.position.y = (length - head) / 2;
      tip.scale.setScalar(head / (3.2 * thick));
      tip.position.y = length - head / 2;
      whole.position.set(...stance.points[k], 0);
      whole.quaternion.setFromUnitVectors(up, push.normalize());
    });
  }
}
