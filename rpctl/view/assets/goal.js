/* Where the robot is to go: a ghost of it that is dragged by its hand, over the ground and by the
   arrow of its heading; and Go, or the command that does the same. The page is { base, values,
   show(), busy(on) }. */
function makeGoal(data, page, scene, kinematics, live) {
  const $ = (id) => document.getElementById(id);
  const { hand, moves, heading, command, laws } = data.goal;
  const DIGITS = 4; // of positions in the command
  const SAME = 5e-5; // rad or m; a joint that moves less stays
  const arms = data.joints.flatMap((joint, i) => (joint.role === "arm" ? [i] : []));
  const wrap = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
  const size = Math.max(...[0, 1].map((i) => data.robot[1][i] - data.robot[0][i]));
  const ring = 0.62 * size, reach = 1.5 * ring; // m; radius of the ring, and of its arrow's tip
  const handles = scene && makeHandles(data, scene), marker = scene && moves && makeMarker();
  let on = false, pose = [0, 0, 0], values = [...page.values], running = false;

  for (const name of laws) $("goal-law").append(new Option(name, name));
  $("goal-law").parentElement.hidden = !live;
  $("goal-go").hidden = !live;
  $("goal-pose").hidden = !moves;
  $("goal-toggle").hidden = !moves && !arms.length;
  $("goal-toggle").addEventListener("click", () => turn(!on));
  $("goal-go").addEventListener("click", go);
  $("goal-copy").addEventListener("click", copy);
  $("goal-law").addEventListener("change", () => show(false));
  ["x", "y", "heading"].forEach((name, i) => $(`goal-${name}`).addEventListener("input", (event) => {
    const value = event.target.valueAsNumber;
    if (!Number.isFinite(value)) return;
    pose[i] = i === 2 ? value * Math.PI / 180 : value;
    show(false);
  }));
  if (live) live.onEnd(() => { run(false); show(); });
  turn(false);
  return { turn, go, drag, refresh: () => show(false), command: text, state: () => ({ on, pose, values, running }),
    grips: () => (on ? grips() : hand ? [posing()] : []), handles, begin: () => run(true) };

  // ---- state ----------------------------------------------------------------------------

  /* Return the pose of P for a pose of the root link, and the other way round. */
  function ofPoint([x, y, angle]) {
    const [px, py] = data.point, c = Math.cos(angle), s = Math.sin(angle);
    return [x + c * px - s * py, y + s * px + c * py, angle + heading];
  }

  function ofRoot([x, y, angle]) {
    const [px, py] = data.point, c = Math.cos(angle - heading), s = Math.sin(angle - heading);
    return [x - c * px + s * py, y - s * px - c * py, angle - heading];
  }

  function turn(wanted) {
    on = wanted;
    if (on) {
      pose = ofPoint(page.base);
      values = [...page.values];
      if (moves) [0, 1].forEach((i) => { pose[i] += 1.5 * size * [Math.cos(pose[2]), Math.sin(pose[2])][i]; });
    }
    $("goal").hidden = !on;
    $("goal-toggle").setAttribute("aria-pressed", String(on));
    grip();
    show();
    if (on && scene) scene.look(around());
  }

  /* The box that holds the robot and its goal. */
  function around() {
    const [low, high] = data.robot, ends = [page.base, ofRoot(pose)];
    const edge = (of, side) => [0, 1].map((i) => of(...ends.map((end) => end[i])) + side * reach);
    return [[...edge(Math.min, -1), low[2]], [...edge(Math.max, 1), high[2]]];
  }

  function grip() { if (handles) handles.set(running ? [] : on ? grips() : hand ? [posing()] : []); }

  function run(now) {
    running = now;
    page.busy(now);
    $("goal-go").disabled = now;
    grip();
  }

  /* Show the goal, and what it is in numbers. */
  function show(fields = true) {
    if (scene) {
      scene.reveal("reference", on || running);
      if (on && !running) scene.pose(ofRoot(pose), values, "reference");
      if (marker) {
        marker.visible = on;
        marker.position.set(pose[0], pose[1], data.ground + 0.004);
        marker.rotation.z = pose[2];
      }
    }
    if (!on) return;
    if (fields) {
      $("goal-x").value = pose[0].toFixed(3);
      $("goal-y").value = pose[1].toFixed(3);
      $("goal-heading").value = (wrap(pose[2]) * 180 / Math.PI).toFixed(1);
    }
    if (!running) $("goal-command").replaceChildren(...words().flatMap((word) => {
      const whole = document.createElement("span"); // an option breaks no line within
      whole.textContent = word;
      return [whole, " "];
    }));
  }

  // ---- handles --------------------------------------------------------------------------

  function posing() {
    return {
      plane: "view", at: () => kinematics.hand(page.base, page.values).p,
      drag: (point) => {
        page.values.splice(0, page.values.length, ...kinematics.reach(page.base, page.values, point));
        page.show();
      },
    };
  }

  function grips() {
    const ground = (x, y) => [x, y, data.ground];
    const list = hand ? [{
      plane: "view", at: () => kinematics.hand(ofRoot(pose), values).p,
      drag: (point) => { values = kinematics.reach(ofRoot(pose), values, point); show(); },
    }] : [];
    if (moves) list.push({
      plane: "ground",
      at: () => ground(pose[0] + reach * Math.cos(pose[2]), pose[1] + reach * Math.sin(pose[2])),
      drag: ([x, y]) => { pose[2] = Math.atan2(y - pose[1], x - pose[0]); show(); },
    }, {
      plane: "ground", radius: ring, at: () => ground(pose[0], pose[1]),
      drag: ([x, y]) => { [pose[0], pose[1]] = [x, y]; show(); },
    });
    return list;
  }

  /* Drag a handle of the goal to a point (m, z up), as a pointer does: "hand", "base" or "arrow". */
  function drag(name, point) {
    const names = [...(hand ? ["hand"] : []), ...(moves ? ["arrow", "base"] : [])];
    grips()[names.indexOf(name)].drag(point);
  }

  /* The ring on the ground and its arrow. */
  function makeMarker() {
    const { THREE } = MeshCat, group = new THREE.Group();
    const colour = getComputedStyle(document.documentElement).getPropertyValue("--ghost").trim();
    const add = (geometry, opacity) => {
      const material = new THREE.MeshBasicMaterial({ color: colour, side: THREE.DoubleSide,
        transparent: true, opacity, depthWrite: false });
      const mesh = new THREE.Mesh(geometry, material);
      mesh.renderOrder = 4;
      group.add(mesh);
    };
    add(new THREE.RingGeometry(0.9 * ring, ring, 72), 0.9);
    add(new THREE.CircleGeometry(0.9 * ring, 72), 0.12);
    const arrow = new THREE.BufferGeometry(), w = 0.05 * ring, from = ring, to = reach - 0.16 * ring;
    const corners = [[from, -w], [to, -w], [to, w], [from, -w], [to, w], [from, w],
      [to, -3 * w], [reach, 0], [to, 3 * w]];
    const places = new Float32Array(corners.flatMap(([x, y]) => [x, y, 0]));
    arrow.setAttribute("position", new THREE.BufferAttribute(places, 3));
    add(arrow, 0.9);
    group.name = "goal-marker";
    scene.node("robots").add(group);
    return group;
  }

  // ---- going there ----------------------------------------------------------------------

  function rounded(value, joint) {
    const unit = 10 ** DIGITS, { lower, upper } = joint || { lower: null, upper: null };
    let steps = Math.round(value * unit);
    if (upper !== null && steps / unit > upper) steps = Math.floor(upper * unit);
    if (lower !== null && steps / unit < lower) steps = Math.ceil(lower * unit);
    return String(steps / unit || 0);
  }

  function quoted(word) { return /^[\w@%+=:,.\/-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`; }

  function named(joints, of) {
    return Object.fromEntries(joints.map((i) => [data.joints[i].name, of[i]]));
  }

  /* Return the command that goes from here to the goal: it begins where the robot stands. */
  function text() { return words().join(" "); }

  /* Return the command, each option with its value. */
  function words() {
    const found = [command], start = ofPoint(page.base);
    const option = (name, i, of) =>
      found.push(`${name} ${quoted(`${data.joints[i].name}=${rounded(of[i], data.joints[i])}`)}`);
    for (const i of arms)
      if (Math.abs(page.values[i] - data.joints[i].position) > SAME) option("--home", i, page.values);
    if (moves) {
      const [dx, dy] = [pose[0] - start[0], pose[1] - start[1]];
      const c = Math.cos(start[2]), s = Math.sin(start[2]);
      const seen = [c * dx + s * dy, -s * dx + c * dy, wrap(pose[2] - start[2])];
      found.push(`--goal ${seen.map((value) => rounded(value)).join(",")}`);
    }
    for (const i of arms)
      if (Math.abs(values[i] - page.values[i]) > SAME) option("--arm-goal", i, values);
    const law = $("goal-law").value;
    if (live && law !== laws[0]) found.push(`--kinematic ${law}`);
    return found;
  }

  async function go() {
    run(true);
    const changed = arms.filter((i) => Math.abs(values[i] - page.values[i]) > SAME);
    const granted = await live.post(data.live.go, {
      start: ofPoint(page.base), posture: named(arms, page.values),
      goal: moves ? pose : null, arm: named(changed, values), kinematic: $("goal-law").value,
    });
    if (!granted) run(false);
  }

  async function copy() {
    try {
      await navigator.clipboard.writeText(text());
      $("goal-copy").textContent = "Copied";
    } catch {
      getSelection().selectAllChildren($("goal-command"));
      $("goal-copy").textContent = "Selected";
    }
    setTimeout(() => { $("goal-copy").textContent = "Copy"; }, 1500);
  }
}
