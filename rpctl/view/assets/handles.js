/* Handles in the scene that a pointer drags: the hand's, in the plane of the picture, and those of
   a goal, on the ground. A handle is { at(), plane, drag(point), radius? }: where it is (m, z up),
   whether it moves in the "view" or on the "ground", what a drag does, and how far around it, in
   metres on the ground, it can be grabbed. */
function makeHandles(data, scene) {
  const { THREE } = MeshCat, { viewer } = scene;
  const PIXELS = 8; // radius of a dot
  const GRAB = { mouse: 14, pen: 18, touch: 28 }; // pixels from a dot where it is grabbed
  const pane = document.getElementById("scene"), parent = scene.node("robots");
  const raycaster = new THREE.Raycaster();
  let dots = [], handles = [], held = null;

  const render = viewer.render.bind(viewer);
  viewer.render = () => { place(); render(); };
  for (const [kind, act] of [["pointerdown", grab], ["pointermove", move], ["pointerup", drop],
    ["pointercancel", drop]]) pane.addEventListener(kind, act, { capture: true });
  return { set, pixel, held: () => held !== null };

  /* Show these handles, those that come first over the others. */
  function set(list) {
    for (const dot of dots) parent.remove(dot);
    handles = list;
    dots = list.map(({ radius }) => (radius ? new THREE.Group() : makeDot()));
    for (const dot of dots) parent.add(dot);
    viewer.set_dirty();
  }

  function makeDot() {
    const dot = new THREE.Group();
    const accent = getComputedStyle(document.documentElement).getPropertyValue("--accent").trim();
    for (const [colour, size, order] of [["#ffffff", 1, 20], [accent, 0.72, 21]]) {
      const material = new THREE.MeshBasicMaterial({ color: colour, depthTest: false, transparent: true });
      const ball = new THREE.Mesh(new THREE.SphereGeometry(size, 24, 16), material);
      ball.renderOrder = order;
      dot.add(ball);
    }
    return dot;
  }

  /* Put the dots where their handles are, as large in the picture wherever that is. */
  function place() {
    const { camera } = viewer, height = pane.clientHeight || 1;
    handles.forEach((handle, k) => {
      dots[k].position.set(...handle.at());
      const far = parent.localToWorld(dots[k].position.clone()).distanceTo(camera.position);
      dots[k].scale.setScalar(2 * PIXELS * far * Math.tan(camera.fov * Math.PI / 360) / height);
    });
  }

  /* Return where a point (m, z up) is in the picture, px from its upper left corner. */
  function pixel(point) {
    viewer.camera.updateMatrixWorld();
    const spot = parent.localToWorld(new THREE.Vector3(...point)).project(viewer.camera);
    return [(spot.x + 1) / 2 * pane.clientWidth, (1 - spot.y) / 2 * pane.clientHeight];
  }

  /* Return where the pointer's ray meets a plane through a point, or null. */
  function meet(event, kind, [x, y, z]) {
    const box = pane.getBoundingClientRect();
    raycaster.setFromCamera(new THREE.Vector2(2 * (event.clientX - box.left) / box.width - 1,
      1 - 2 * (event.clientY - box.top) / box.height), viewer.camera);
    const through = parent.localToWorld(new THREE.Vector3(x, y, z));
    const normal = kind === "ground" ? new THREE.Vector3(0, 1, 0)
      : viewer.camera.getWorldDirection(new THREE.Vector3());
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, through);
    const found = raycaster.ray.intersectPlane(plane, new THREE.Vector3());
    return found && parent.worldToLocal(found).toArray();
  }

  function find(event) {
    const box = pane.getBoundingClientRect(), range = GRAB[event.pointerType] || GRAB.mouse;
    const near = (handle) => {
      const at = handle.at();
      if (handle.radius) {
        const point = meet(event, "ground", at);
        return point !== null && Math.hypot(point[0] - at[0], point[1] - at[1]) < handle.radius;
      }
      const [x, y] = pixel(at);
      return Math.hypot(event.clientX - box.left - x, event.clientY - box.top - y) < range;
    };
    return handles.find(near) || null;
  }

  function grab(event) {
    const handle = event.isPrimary && event.button === 0 ? find(event) : null;
    if (!handle) return;
    const at = handle.at(), from = meet(event, handle.plane, at);
    if (!from) return;
    event.preventDefault();
    event.stopPropagation();
    pane.setPointerCapture(event.pointerId);
    viewer.controls.enabled = false;
    held = { handle, at, offset: at.map((value, i) => value - from[i]), id: event.pointerId };
    pane.style.cursor = "grabbing";
  }

  function move(event) {
    if (!held) {
      if (event.pointerType !== "touch") pane.style.cursor = find(event) ? "grab" : "";
      return;
    }
    if (event.pointerId !== held.id) return;
    event.stopPropagation();
    const point = meet(event, held.handle.plane, held.at);
    if (point) held.handle.drag(point.map((value, i) => value + held.offset[i]));
    viewer.set_dirty();
  }

  function drop(event) {
    if (!held || event.pointerId !== held.id) return;
    event.stopPropagation();
    held = null;
    viewer.controls.enabled = true;
    pane.style.cursor = "";
  }
}
