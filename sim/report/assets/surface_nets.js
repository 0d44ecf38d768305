"use strict";
// The surface on which a field on a lattice is 0, by naive surface nets (Gibson 1998): one vertex in each cell that the
// surface crosses, in the middle of its crossings, and a square across each edge of the lattice that it crosses.
// field: numbers in C order, x slowest; dims: [X, Y, Z]. Returns positions in units of cells, and triangles that face
// where the field is negative.
const surfaceNets = (field, dims) => {
  const [X, Y, Z] = dims, sx = Y * Z, sy = Z;
  const corner = [0, 1, sy, sy + 1, sx, sx + 1, sx + sy, sx + sy + 1];
  const offset = [[0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1], [1, 0, 0], [1, 0, 1], [1, 1, 0], [1, 1, 1]];
  const edges = [];
  for (let a = 0; a < 8; a++) for (let bit = 1; bit < 8; bit <<= 1) if (!(a & bit)) edges.push([a, a | bit]);
  const vertexOf = new Int32Array(X * Y * Z).fill(-1);
  const positions = [], triangles = [];
  for (let i = 0; i + 1 < X; i++) for (let j = 0; j + 1 < Y; j++) {
    for (let k = 0, at = i * sx + j * sy; k + 1 < Z; k++, at++) {
      let mask = 0;
      for (let c = 0; c < 8; c++) if (field[at + corner[c]] > 0) mask |= 1 << c;
      if (mask === 0 || mask === 255) continue;
      let x = 0, y = 0, z = 0, n = 0;
      for (const [a, b] of edges) {
        const isA = mask >> a & 1;
        if (isA === (mask >> b & 1)) continue;
        const fa = field[at + corner[a]], fb = field[at + corner[b]], t = fa / (fa - fb);
        x += offset[a][0] + t * (offset[b][0] - offset[a][0]);
        y += offset[a][1] + t * (offset[b][1] - offset[a][1]);
        z += offset[a][2] + t * (offset[b][2] - offset[a][2]);
        n++;
      }
      vertexOf[at] = positions.length / 3;
      positions.push(i + x / n, j + y / n, k + z / n);
      // An edge from this cell's first corner; the four cells around it come before or are this one.
      const isIn = mask & 1;
      const square = (other, u, v) => {
        const a = vertexOf[at], b = vertexOf[at - u], c = vertexOf[at - u - v], d = vertexOf[at - v];
        if (b < 0 || c < 0 || d < 0) return;
        if (isIn === other) triangles.push(a, b, c, a, c, d); else triangles.push(a, c, b, a, d, c);
      };
      if (isIn !== (mask >> 4 & 1) && j > 0 && k > 0) square(1, sy, 1);
      if (isIn !== (mask >> 2 & 1) && i > 0 && k > 0) square(0, sx, 1);
      if (isIn !== (mask >> 1 & 1) && i > 0 && j > 0) square(1, sx, sy);
    }
  }
  return { positions: new Float32Array(positions), triangles: new Uint32Array(triangles) };
};

// The history of a map: unpacks the lattice and the maps, tells the field of one of them and cuts its surface. Each point
// beside the organ has a lender inside, whose value it takes.
const mapHistory = (map, array) => {
  const [X, Y, Z] = map.shape, inside = array(map.inside), n = X * Y * Z;
  const cells = new Int32Array(map.n_inside);
  const isInside = new Uint8Array(n);
  for (let i = 0, found = 0; i < n; i++) if (inside[i >> 3] >> (i & 7) & 1) { isInside[i] = 1; cells[found++] = i; }
  // Each map is kept as its difference from the one after, so that the last one, which is shown first, is there at once.
  const maps = new Map();
  const mapAt = index => {
    let from = index;
    while (from < map.maps.length && !maps.has(from)) from++;
    for (let i = from - 1; i >= index; i--) {
      const values = Int8Array.from(array(map.maps[i])), after = maps.get(i + 1);
      if (after) for (let k = 0; k < values.length; k++) values[k] += after[k];
      maps.set(i, values);
    }
    return maps.get(index);
  };
  // Points outside but beside the organ take the value of a neighbour inside, so that the map reaches the organ's edge.
  const borrowers = [], lenders = [], known = Uint8Array.from(isInside), lender = new Int32Array(n);
  for (const cell of cells) lender[cell] = cell;
  const steps = [Y * Z, -Y * Z, Z, -Z, 1, -1];
  let edge = cells;
  for (let layer = 0; layer < 2; layer++) {
    const fresh = [];
    for (const i of edge) {
      const z = i % Z, y = (i / Z | 0) % Y, x = i / (Y * Z) | 0;
      const inRange = [x + 1 < X, x > 0, y + 1 < Y, y > 0, z + 1 < Z, z > 0];
      for (let s = 0; s < 6; s++) {
        const to = i + steps[s];
        if (!inRange[s] || known[to]) continue;
        known[to] = 1;
        lender[to] = lender[i];
        fresh.push(to);
        borrowers.push(to);
        lenders.push(lender[i]);
      }
    }
    edge = fresh;
  }
  const factor = Math.max(1, Math.min(4, Math.ceil(Math.max(...map.cell) / 0.0034)));
  const mask = refined(Float32Array.from(isInside), map.shape, factor, false);
  const dims = map.shape.map(size => (size - 1) * factor + 1);

  // The log-odds at the lattice's points inside the organ; null where no map was kept.
  const fieldAt = index => {
    if (index < 0) return null;
    const coarse = new Float32Array(n).fill(-6), values = mapAt(index);
    for (let i = 0; i < cells.length; i++) coarse[cells[i]] = values[i] * map.log_odds_step;
    return coarse;
  };
  const cut = (index, level) => {
    const coarse = fieldAt(index);
    for (let i = 0; i < borrowers.length; i++) coarse[borrowers[i]] = coarse[lenders[i]];
    const fine = refined(coarse, map.shape, factor, true);
    const padded = dims.map(size => size + 2), field = new Float32Array(padded[0] * padded[1] * padded[2]).fill(-1);
    for (let i = 0, at = 0; i < dims[0]; i++) for (let j = 0; j < dims[1]; j++) {
      let to = ((i + 1) * padded[1] + j + 1) * padded[2] + 1;
      for (let k = 0; k < dims[2]; k++, at++, to++) field[to] = Math.min(fine[at] - level, (mask[at] - 0.5) * 12);
    }
    const surface = surfaceNets(field, padded);
    for (let i = 0; i < surface.positions.length; i++) {
      surface.positions[i] = map.low[i % 3] + (surface.positions[i] - 1) / factor * map.cell[i % 3];
    }
    return surface;
  };
  return { cut, fieldAt, isInside, cells, lender };
};

// A field with more points between its points along each axis: by cubic (Catmull-Rom) or linear interpolation.
const refined = (field, shape, factor, isCubic) => {
  if (factor === 1) return field;
  let values = field;
  const dims = [...shape];
  for (let axis = 0; axis < 3; axis++) {
    const size = dims[axis], fine = (size - 1) * factor + 1;
    const inner = dims.slice(axis + 1).reduce((a, b) => a * b, 1), outer = dims.slice(0, axis).reduce((a, b) => a * b, 1);
    const next = new Float32Array(outer * fine * inner);
    for (let place = 0; place < fine; place++) {
      const i = Math.min(place / factor | 0, Math.max(size - 2, 0)), t = place / factor - i;
      const weights = isCubic
        ? [((2 - t) * t - 1) * t / 2, ((3 * t - 5) * t * t + 2) / 2, ((4 - 3 * t) * t + 1) * t / 2, (t - 1) * t * t / 2]
        : [0, 1 - t, t, 0];
      const rows = [-1, 0, 1, 2].map(step => Math.min(Math.max(i + step, 0), size - 1) * inner);
      for (let o = 0; o < outer; o++) {
        const from = o * size * inner, to = (o * fine + place) * inner;
        for (let q = 0; q < inner; q++) {
          next[to + q] = weights[0] * values[from + rows[0] + q] + weights[1] * values[from + rows[1] + q]
            + weights[2] * values[from + rows[2] + q] + weights[3] * values[from + rows[3] + q];
        }
      }
    }
    values = next;
    dims[axis] = fine;
  }
  return values;
};
