/* The panel: a slider for the base's coordinates and for every joint; or, where a simulation is
   watched, what they are at the moment. */
(() => {
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("rpctl-data").textContent);
  const watching = data.live !== null && data.live.duration !== null;
  const TURN = 0.05; // rad; of a longer turn the wheels' rolling is summed up in parts
  const KEY = `rpctl ${data.name}`;
  const wrap = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));

  let scene = null, goal = null;
  const base = [...data.start], values = data.joints.map((joint) => joint.position);
  const wheels = data.wheels.map((w) => data.joints.findIndex((joint) => joint.name === w.joint));

  try {
    scene = makeScene(data);
  } catch (error) {
    $("failure").hidden = false;
    document.body.classList.add("flat");
  }
  const rows = [...baseRows(), ...jointRows()];
  window.rpctl = {
    ready: false, scene, base, values, set, home: () => reset(true), zero: () => reset(false),
    time: null,
  };
  $("buttons").hidden = watching;
  $("home").addEventListener("click", () => reset(true));
  $("zero").addEventListener("click", () => reset(false));
  if (!watching) recall();
  show();
  if (scene) scene.camera(data.area ? "area" : "robot");
  const kinematics = makeKinematics(data.joints, data.goal && data.goal.hand, data.height);
  const live = data.live && makeLive(data, { show: follow, ghost, extend, clear, begin });
  goal = data.goal && makeGoal(data, { base, values, show, busy }, scene, kinematics, live);
  Object.assign(window.rpctl, { kinematics, goal, ready: scene !== null });

  // ---- rows -----------------------------------------------------------------------------

  function baseRows() {
    if (!data.reach) return [];
    section("Base (pose of the root link)");
    const [low, high] = data.reach;
    return ["x", "y", "heading"].map((name, i) => {
      const turns = i === 2, start = data.start[i];
      const range = turns ? [-Math.PI, Math.PI] : [start + low, start + high];
      return row(name, range, turns ? "rad" : "m", () => base[i], (value) => move(i, value));
    });
  }

  function jointRows() {
    const made = [];
    for (const [role, title] of [["arm", "Joints"], ["wheel", "Wheels"], ["other", "Other joints"],
      ["mimic", "Mimic joints"]]) {
      const members = data.joints.map((joint, i) => [joint, i]).filter(([j]) => j.role === role);
      if (members.length) section(title, data.names.shared[role]);
      for (const [joint, i] of members) {
        const unit = joint.slides ? "m" : "rad", get = () => values[i];
        const set = role === "mimic" ? null : (value) => turn(i, value);
        made.push(row(joint.name, range(joint), unit, get, set, follows(joint)));
      }
    }
    const locked = Object.entries(data.locked);
    if (locked.length) section("Locked", data.names.shared.locked);
    for (const [name, { position, unit }] of locked)
      made.push(row(name, null, unit, () => position, null));
    return made;
  }

  function follows({ mimic }) {
    if (!mimic) return null;
    const { name, multiplier: k, offset: c } = mimic;
    return `= ${k === 1 ? "" : `${k} × `}${name}${c ? ` ${c < 0 ? "−" : "+"} ${Math.abs(c)}` : ""}`;
  }

  function range({ lower, upper, slides }) {
    const reach = slides ? 1 : Math.PI;
    if (lower === null && upper === null) return [-reach, reach];
    return [lower ?? upper - 2 * reach, upper ?? lower + 2 * reach];
  }

  /* A heading; what its rows' names share is said there once. */
  function section(title, shared = "") {
    const heading = document.createElement("h2");
    heading.textContent = title;
    if (shared) heading.append(Object.assign(document.createElement("small"), { textContent: ` ${shared}` }));
    $("sliders").append(heading);
  }

  function row(name, limits, unit, get, set, note = null) {
    const make = (kind, parent, type = "") => {
      const element = document.createElement(kind);
      if (type) element.className = type;
      parent.append(element);
      return element;
    };
    const box = make("div", $("sliders"), "row"), head = make("div", box, "head");
    const title = make(limits ? "label" : "span", head, "name"), out = make("output", head);
    title.textContent = data.names.short[name] ?? name;
    title.title = name;
    if (note) make("div", box, "follows").textContent = note;
    let slider = null;
    if (limits) {
      slider = make("input", box);
      Object.assign(slider, { type: "range", step: "any", id: `joint ${name}` });
      [slider.min, slider.max] = limits;
      slider.disabled = watching || !set;
      title.htmlFor = slider.id;
      slider.setAttribute("aria-label", name);
      slider.addEventListener("input", () => { set(Number(slider.value)); show(); });
    }
    const update = () => {
      const value = get(), text = `${value.toFixed(3).replace(/^-(0\.0*)$/, "$1")} ${unit}`;
      if (slider) { slider.value = value; slider.setAttribute("aria-valuetext", text); }
      out.textContent = text.replace("-", "−");
      if (unit !== "rad") return;
      make("small", out).textContent = ` ${(value * 180 / Math.PI).toFixed(0).replace(/^-0$/, "0")
        .replace("-", "−")}°`;
    };
    return { name, set, limits, update };
  }

  // ---- motion ---------------------------------------------------------------------------

  function show() {
    for (const each of rows) each.update();
    if (scene) scene.pose(base, values);
    if (goal) goal.refresh();
    if (!watching) remember();
  }

  /* Set the value of a slider: "x", "y", "heading" or a joint's name. */
  function set(name, value) {
    const found = rows.find((each) => each.name === name && each.set);
    if (!found) throw new Error(`no slider is named ${name}`);
    found.set(Math.min(Math.max(value, found.limits[0]), found.limits[1]));
    show();
  }

  function turn(i, value) {
    const before = scene ? scene.ground() : [];
    values[i] = value;
    for (const [k, { mimic }] of data.joints.entries())
      if (mimic && mimic.follows !== null) values[k] = mimic.multiplier * values[mimic.follows] + mimic.offset;
    if (!scene) return;
    scene.pose(base, values);
    scene.ground().forEach((contact, k) => roll(k, contact, contact.place.clone().sub(before[k].place)));
  }

  /* Move the base; its wheels roll as far as it goes, and slide where it goes across. */
  function move(i, value) {
    const step = [0, 0, 0];
    const parts = Math.max(1, Math.ceil(i === 2 ? Math.abs(value - base[2]) / TURN : 1));
    step[i] = (value - base[i]) / parts;
    const contacts = scene ? scene.ground() : [];
    for (let part = 0; part < parts; part++) {
      const cos = Math.cos(base[2] + step[2] / 2), sin = Math.sin(base[2] + step[2] / 2);
      contacts.forEach((contact, k) => {
        const { x, y } = contact.place;
        roll(k, contact, { x: cos * step[0] + sin * step[1] - step[2] * y,
          y: -sin * step[0] + cos * step[1] + step[2] * x });
      });
      step.forEach((by, k) => { base[k] += by; });
    }
    base[i] = value;
  }

  /* The contact stands still along its direction d: the way of the centre and the wheel's turn
     about its axle a cancel there, way · d = angle r (a × up) · d. */
  function roll(k, { axle, along, radius }, way) {
    const grip = radius * (axle.y * along.x - axle.x * along.y);
    const i = wheels[k];
    if (i < 0 || Math.abs(grip) < 1e-9) return;
    values[i] = wrap(values[i] + (way.x * along.x + way.y * along.y) / grip);
  }

  function reset(home) {
    base.splice(0, 3, ...data.start);
    data.joints.forEach((joint, i) => {
      const [low, high] = range(joint);
      values[i] = home ? joint.position : Math.min(Math.max(0, low), high);
    });
    for (const [i, joint] of data.joints.entries())
      if (joint.role !== "mimic") turn(i, values[i]);
    data.joints.forEach((joint, i) => { if (joint.role === "wheel") values[i] = 0; });
    show();
  }

  // ---- a page that is loaded again shows the robot as it stood ----------------------------

  function remember() {
    try {
      sessionStorage.setItem(KEY, JSON.stringify({ base, values, names: data.joints.map((j) => j.name) }));
    } catch { /* a page that may keep nothing starts anew */ }
  }

  function recall() {
    let kept = null;
    try { kept = JSON.parse(sessionStorage.getItem(KEY)); } catch { return; }
    if (!kept || String(kept.names) !== String(data.joints.map((joint) => joint.name))) return;
    base.splice(0, 3, ...kept.base);
    values.splice(0, values.length, ...kept.values);
  }

  // ---- a simulation's motion ----------------------------------------------------------------

  function follow(pose, positions) {
    base.splice(0, 3, ...pose);
    values.splice(0, values.length, ...positions);
    show();
  }

  function begin() {
    if (goal) goal.begin();
    if (scene) scene.reveal("reference", true);
  }

  /* A motion is shown: nothing else moves the robot meanwhile. */
  function busy(on) {
    $("sliders").inert = on;
    for (const button of $("buttons").children) button.disabled = on;
  }

  function ghost(pose, positions) { if (scene) scene.pose(pose, positions, "reference"); }

  function extend(pose) { if (scene) scene.extend(pose); }

  function clear() { if (scene) scene.clear(); }
})();
