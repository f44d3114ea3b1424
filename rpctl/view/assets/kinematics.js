/* The robot's kinematics: poses of joints and of the hand (the end effector), its Jacobian, and
   inverse kinematics within the joints' limits. Poses are { R, p }: a rotation, row after row, and
   a position (m), in the world, whose z is up. `joints` and `hand` are those of the page's
   data; `height` is the root link's, m. */
function makeKinematics(joints, hand, height) {
  const STEPS = 60; // of one reach
  const LONGEST = 0.25; // m or rad; a joint's longest step
  const CLOSE = 1e-10; // m; nearer, the hand is there
  const FIRST_DAMPING = 1e-3, LEAST_DAMPING = 1e-9, MOST_DAMPING = 1e6; // m², of the least squares
  const carriers = hand ? chain(hand.joint) : [];
  const arm = hand ? drivers() : [];
  return { joints: poses, hand: hand && place, jacobian, reach, follow, arm };

  /* Return the joints (indices) from the root to one, in this order. */
  function chain(i) { return i < 0 ? [] : [...chain(joints[i].parent), i]; }

  /* Return the joints that can move the hand: of the arm, in its chain or followed by one there. */
  function drivers() {
    const found = carriers.map((i) => (joints[i].mimic ? joints[i].mimic.follows : i));
    return [...new Set(found)].filter((i) => i !== null && joints[i].role === "arm");
  }

  function multiply(a, b) {
    const R = Array(9), p = Array(3);
    for (let i = 0; i < 3; i++) {
      for (let j = 0; j < 3; j++)
        R[3 * i + j] = a.R[3 * i] * b.R[j] + a.R[3 * i + 1] * b.R[3 + j] + a.R[3 * i + 2] * b.R[6 + j];
      p[i] = a.R[3 * i] * b.p[0] + a.R[3 * i + 1] * b.p[1] + a.R[3 * i + 2] * b.p[2] + a.p[i];
    }
    return { R, p };
  }

  function turned(a, v) {
    return [0, 1, 2].map((i) => a.R[3 * i] * v[0] + a.R[3 * i + 1] * v[1] + a.R[3 * i + 2] * v[2]);
  }

  function cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }

  function moved({ axis: [x, y, z], slides }, value) {
    if (slides) return { R: [1, 0, 0, 0, 1, 0, 0, 0, 1], p: [x * value, y * value, z * value] };
    const c = Math.cos(value), s = Math.sin(value), k = 1 - c;
    return { R: [c + x * x * k, x * y * k - z * s, x * z * k + y * s,
      y * x * k + z * s, c + y * y * k, y * z * k - x * s,
      z * x * k - y * s, z * y * k + x * s, c + z * z * k], p: [0, 0, 0] };
  }

  function trunk([x, y, heading]) {
    const c = Math.cos(heading), s = Math.sin(heading);
    return { R: [c, -s, 0, s, c, 0, 0, 0, 1], p: [x, y, height] };
  }

  /* Return the poses of joints (all, or the indices given), for a pose (x, y, heading) of the root
     link and positions of all joints. */
  function poses(base, values, which = joints.map((_, i) => i)) {
    const made = { "-1": trunk(base) };
    const at = (i) => (made[i] ??= multiply(multiply(at(joints[i].parent), joints[i].place),
      moved(joints[i], values[i])));
    return which.map(at);
  }

  function place(base, values) {
    const [last] = hand.joint < 0 ? [trunk(base)] : poses(base, values, [hand.joint]);
    return multiply(last, hand.place);
  }

  /* Return the hand's pose, and by the rate of each joint of `arm` its velocity and angular
     velocity, six numbers in the axes of the world. */
  function jacobian(base, values) {
    const at = place(base, values), frames = poses(base, values, carriers);
    const columns = arm.map(() => [0, 0, 0, 0, 0, 0]);
    carriers.forEach((i, k) => {
      const { mimic, slides, axis } = joints[i];
      const column = columns[arm.indexOf(mimic ? mimic.follows : i)];
      if (!column) return;
      const a = turned(frames[k], axis).map((value) => value * (mimic ? mimic.multiplier : 1));
      const arms = at.p.map((value, c) => value - frames[k].p[c]);
      const six = slides ? [...a, 0, 0, 0] : [...cross(a, arms), ...a];
      six.forEach((value, c) => { column[c] += value; });
    });
    return { ...at, columns };
  }

  /* Let the joints that follow others do so, in place. */
  function follow(values) {
    for (const [k, { mimic }] of joints.entries())
      if (mimic && mimic.follows !== null) values[k] = mimic.multiplier * values[mimic.follows] + mimic.offset;
    return values;
  }

  /* Return positions of all joints, near those given, that bring the hand to a place (m) or as
     near as the joints' limits let it come: damped least squares, damped more where a step brings
     it no nearer. */
  function reach(base, values, target) {
    let now = follow([...values]), damping = FIRST_DAMPING;
    let miss = missing(base, now, target), gap = Math.hypot(...miss);
    for (let step = 0; step < STEPS && gap > CLOSE && damping < MOST_DAMPING; step++) {
      const next = stepped(now, jacobian(base, now).columns, miss, damping);
      const left = missing(base, next, target), distance = Math.hypot(...left);
      if (distance < gap) {
        [now, miss, gap] = [next, left, distance];
        damping = Math.max(damping / 10, LEAST_DAMPING);
      } else damping *= 10;
    }
    return now;
  }

  function missing(base, values, target) {
    return place(base, values).p.map((value, i) => target[i] - value);
  }

  function limits(i) { return [joints[i].lower ?? -Infinity, joints[i].upper ?? Infinity]; }

  /* Take one step; a joint that would leave its limits stops there, and the others take over. */
  function stepped(values, columns, miss, damping) {
    const next = [...values], free = new Set(arm.keys());
    let left = miss;
    for (let stopped = true; stopped && free.size;) {
      const step = leastSquares([...free].map((k) => columns[k]), left, damping);
      stopped = false;
      [...free].forEach((k, j) => {
        const i = arm[k], [low, high] = limits(i);
        const wanted = values[i] + step[j];
        if (wanted >= low && wanted <= high) { next[i] = wanted; return; }
        next[i] = Math.min(Math.max(wanted, low), high);
        left = left.map((value, c) => value - columns[k][c] * (next[i] - values[i]));
        free.delete(k);
        stopped = true;
      });
    }
    return follow(next);
  }

  /* Return x = Jᵀ (J Jᵀ + damping I)⁻¹ miss, shortened to the longest step. */
  function leastSquares(columns, miss, damping) {
    const A = [0, 1, 2].map((i) => [0, 1, 2].map((j) =>
      columns.reduce((sum, c) => sum + c[i] * c[j], i === j ? damping : 0)));
    const minors = [0, 1, 2].map((i) => cross(A[(i + 1) % 3], A[(i + 2) % 3]));
    const determinant = A[0].reduce((sum, value, i) => sum + value * minors[0][i], 0);
    const pull = [0, 1, 2].map((i) =>
      minors.reduce((sum, minor, j) => sum + minor[i] * miss[j], 0) / determinant);
    const step = columns.map((c) => c[0] * pull[0] + c[1] * pull[1] + c[2] * pull[2]);
    const longest = Math.max(...step.map(Math.abs), LONGEST);
    return step.map((value) => value * LONGEST / longest);
  }
}
