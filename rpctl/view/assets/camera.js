/* The camera of a scene, which is z-up; three.js is y-up. */

function upright(x, y, z) { return new MeshCat.THREE.Vector3(x, z, -y); }

/* Return eye, direction back to it and depth of the nearest camera in any of some directions that
   has all points in its picture. With the axes of the camera (right, up, back towards it), a point
   is in the picture where |x - cx| <= t (cz - z), t the tangent of half the field of view; likewise
   for y. The nearest camera then follows from the extremes of x + t z and x - t z. */
function nearestView(points, directions, fov, aspect) {
  const tangent = 0.9 * Math.tan(fov * Math.PI / 360); // the motion fills that much of the picture
  const views = directions.map((direction) => {
    const back = direction.clone().normalize();
    const right = new MeshCat.THREE.Vector3(0, 1, 0).cross(back).normalize();
    const up = back.clone().cross(right);
    const span = (axis, t) => {
      const sum = Math.max(...points.map((point) => point.dot(axis) + t * point.dot(back)));
      const difference = Math.min(...points.map((point) => point.dot(axis) - t * point.dot(back)));
      return { away: (sum - difference) / (2 * t), middle: (sum + difference) / 2 };
    };
    const across = span(right, tangent * aspect), along = span(up, tangent);
    const away = Math.max(across.away, along.away);
    const eye = right.multiplyScalar(across.middle)
      .addScaledVector(up, along.middle).addScaledVector(back, away);
    const depths = points.map((point) => away - point.dot(back));
    const depth = Math.max((Math.min(...depths) + Math.max(...depths)) / 2, 0.1);
    return { eye, back, depth };
  });
  return views.reduce((a, b) => (b.depth < a.depth ? b : a));
}
