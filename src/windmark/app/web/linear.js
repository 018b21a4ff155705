// Vectors of three and matrices of four by four (column by column, as WebGL takes them).

WM.add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
WM.scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
WM.dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
WM.cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
WM.length = (a) => Math.hypot(a[0], a[1], a[2]);
WM.unit = (a) => WM.scale(a, 1 / (WM.length(a) || 1));

// A direction turned about a unit axis.
WM.turn = (v, axis, angle) => {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  return WM.add(WM.add(WM.scale(v, c), WM.cross(axis, v), s), axis, WM.dot(axis, v) * (1 - c));
};

WM.times = (a, b) => {
  const out = new Float64Array(16);
  for (let c = 0; c < 4; c++) {
    for (let r = 0; r < 4; r++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + r] * b[4 * c + k];
      out[4 * c + r] = sum;
    }
  }
  return out;
};

// Eye coordinates: x right, y up, looking along -z.
WM.lookAt = (eye, ahead, up) => {
  const z = WM.scale(WM.unit(ahead), -1);
  const x = WM.unit(WM.cross(up, z));
  const y = WM.cross(z, x);
  return Float64Array.of(
    x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
    -WM.dot(x, eye), -WM.dot(y, eye), -WM.dot(z, eye), 1,
  );
};

WM.perspective = (fov, aspect, near, far) => {
  const f = 1 / Math.tan(fov / 2);
  return Float64Array.of(
    f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0,
  );
};

// Pixels of a canvas (x right, y down) and the depth along the line of sight of a point; null behind the eye.
WM.onScreen = (matrix, p, width, height) => {
  const w = matrix[3] * p[0] + matrix[7] * p[1] + matrix[11] * p[2] + matrix[15];
  if (w <= 1e-12) return null;
  const x = matrix[0] * p[0] + matrix[4] * p[1] + matrix[8] * p[2] + matrix[12];
  const y = matrix[1] * p[0] + matrix[5] * p[1] + matrix[9] * p[2] + matrix[13];
  return [(0.5 + (0.5 * x) / w) * width, (0.5 - (0.5 * y) / w) * height, w];
};
