// What is under the cursor: the nearest triangle, marker or camera, worked out from the numbers themselves.

// Pixels and depth of all nodes for one view; made anew only when the view changes.
WM.projectNodes = (surface, matrix, width, height) => {
  const out = new Float32Array(3 * surface.count);
  const p = surface.xyz;
  for (let k = 0; k < surface.count; k++) {
    const x = p[3 * k];
    const y = p[3 * k + 1];
    const z = p[3 * k + 2];
    const w = matrix[3] * x + matrix[7] * y + matrix[11] * z + matrix[15];
    out[3 * k] = (0.5 + (0.5 * (matrix[0] * x + matrix[4] * y + matrix[8] * z + matrix[12])) / w) * width;
    out[3 * k + 1] = (0.5 - (0.5 * (matrix[1] * x + matrix[5] * y + matrix[9] * z + matrix[13])) / w) * height;
    out[3 * k + 2] = w > 1e-12 ? w : NaN;
  }
  return out;
};

// The node nearest to the cursor of the triangle that is seen there: {node, depth, volume}; null beside the surface.
WM.pickSurface = (surface, screen, x, y) => {
  let best = null;
  const t = surface.corners;
  for (const volume of surface.volumes) {
    if (!volume.on) continue;
    for (let k = volume.first; k < volume.first + volume.count; k++) {
      const a = 3 * t[3 * k];
      const b = 3 * t[3 * k + 1];
      const c = 3 * t[3 * k + 2];
      const ax = screen[a] - x;
      const bx = screen[b] - x;
      const cx = screen[c] - x;
      if ((ax < 0 && bx < 0 && cx < 0) || (ax > 0 && bx > 0 && cx > 0)) continue;
      const ay = screen[a + 1] - y;
      const by = screen[b + 1] - y;
      const cy = screen[c + 1] - y;
      if ((ay < 0 && by < 0 && cy < 0) || (ay > 0 && by > 0 && cy > 0)) continue;
      const u = bx * cy - by * cx;
      const v = cx * ay - cy * ax;
      const w = ax * by - ay * bx;
      if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) continue;
      const sum = u + v + w;
      if (sum === 0) continue;
      // Inverse depths are linear on the screen.
      const depth = sum / (u / screen[a + 2] + v / screen[b + 2] + w / screen[c + 2]);
      if (!(depth > 0) || (best && depth >= best.depth)) continue;
      const near = [[ax * ax + ay * ay, a], [bx * bx + by * by, b], [cx * cx + cy * cy, c]];
      near.sort((p, q) => p[0] - q[0]);
      best = { node: near[0][1] / 3, depth, volume: volume.name };
    }
  }
  return best;
};

// The point (markers, stations of cameras) within some pixels of the cursor, not behind `depth`; -1 for none.
WM.pickPoint = (points, matrix, width, height, x, y, depth, reach = 9) => {
  let best = -1;
  let least = reach * reach;
  points.forEach((p, k) => {
    const at = WM.onScreen(matrix, p, width, height);
    if (!at || at[2] > depth) return;
    const far = (at[0] - x) ** 2 + (at[1] - y) ** 2;
    if (far < least) {
      least = far;
      best = k;
    }
  });
  return best;
};
