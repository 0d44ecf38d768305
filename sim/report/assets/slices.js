"use strict";
// Slices through the map in the frame of the organ's file: the probability after an action, and below it how unsure the
// last map is. tell(event, text) shows a text beside the pointer; without a text it hides it. Where there is a second
// class, one of the two maps is chosen.
const MARGIN_PX = 11; // for the letters at the edges, outside the organ

const makeSlices = (data, array, histories, tell) => {
  const map = data.map, T = data.T_world_organ, holder = document.getElementById("planes"), section = document.getElementById("slices");
  const toOrgan = (x, y, z) => { const [a, b, c] = [x - T[0][3], y - T[1][3], z - T[2][3]]; return [0, 1, 2].map(i => T[0][i] * a + T[1][i] * b + T[2][i] * c); };
  const toWorld = p => [0, 1, 2].map(i => T[i][0] * p[0] + T[i][1] * p[1] + T[i][2] * p[2] + T[i][3]);
  const bodyOf = (mesh, colour, box) => {
    const fine = array(mesh.vertices), points = new Float32Array(fine.length);
    for (let i = 0; i < fine.length; i += 3) points.set(toOrgan(...[0, 1, 2].map(k => mesh.low[k] + fine[i + k] * mesh.scale[k])), i);
    return { points, faces: array(mesh.faces), colour, box };
  };
  const bodies = [
    bodyOf(data.organ, "--soft"),
    ...data.structures.map(mesh => bodyOf(mesh, mesh.is_keepout ? "--keepout" : "--structure", "slice-structures")),
  ];
  const classes = [[data, histories.map, "--map", "--truth", data.tumours], ...(histories.target ? [[data.target, histories.target, "--second-map", "--second", data.target.bodies]] : [])].map(([of, history, colour, truth, meshes]) => {
    const known = array(of.map.deviation.values), [least, most] = of.map.deviation.range, found = meshes.map(mesh => bodyOf(mesh, truth, "slice-truth"));
    const deviations = new Float32Array(map.shape[0] * map.shape[1] * map.shape[2]);
    history.cells.forEach((cell, i) => { deviations[cell] = least + known[i] / 255 * (most - least); });
    bodies.push(...found);
    return { map: of.map, history, colour, least, most, deviations, first: found[0] ?? bodies[0] };
  });
  let chosen = classes[0];
  const rangeOf = (points, axis) => { let [low, high] = [Infinity, -Infinity]; for (let i = axis; i < points.length; i += 3) { low = Math.min(low, points[i]); high = Math.max(high, points[i]); } return [low, high]; };
  const box = [0, 1, 2].map(axis => rangeOf(bodies[0].points, axis));
  const pixel = Math.max(...box.map(([low, high]) => high - low)) / 200;

  // In a patient's axes the planes and their edges have names of their own; a slice is seen from the feet, or from the front.
  const planes = data.is_patient
    ? [["Axial", 2, 0, 1, 1, "RLAP"], ["Coronal", 1, 0, 2, -1, "RLHF"], ["Sagittal", 0, 1, 2, -1, "APHF"]]
    : [["Across z", 2, 0, 1, -1, ["−x", "+x", "+y", "−y"]], ["Across y", 1, 0, 2, -1, ["−x", "+x", "+z", "−z"]], ["Across x", 0, 1, 2, -1, ["−y", "+y", "+z", "−z"]]];
  const axisNames = data.is_patient ? ["x, to the left", "y, to the back", "z, to the head"] : ["x", "y", "z"];
  let step = map.steps[map.steps.length - 1], isNear = false;

  const rgb = name => {
    const probe = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
    probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    probe.fillRect(0, 0, 1, 1);
    return probe.getImageData(0, 0, 1, 1).data;
  };
  // The share of the organ and a field between the lattice's points.
  const sample = (field, at) => {
    const [i, j, k] = at.map(Math.floor), [X, Y, Z] = map.shape;
    if (i < 0 || j < 0 || k < 0 || i + 1 >= X || j + 1 >= Y || k + 1 >= Z) return null;
    const [a, b, c] = [at[0] - i, at[1] - j, at[2] - k], { history } = chosen;
    let inside = 0, value = 0;
    for (let n = 0; n < 8; n++) {
      const [p, q, r] = [n >> 2, n >> 1 & 1, n & 1], cell = ((i + p) * Y + j + q) * Z + k + r;
      const weight = (p ? a : 1 - a) * (q ? b : 1 - b) * (r ? c : 1 - c);
      inside += weight * history.isInside[cell];
      value += weight * field[history.lender[cell]];
    }
    return inside >= 0.4 ? value : null;
  };
  const middleOf = (body, axis) => Math.round(rangeOf(body.points, axis).reduce((a, b) => a + b) * 500);
  const views = planes.map(([title, axis, u, v, sign, edges]) => {
    const [low, high] = box[axis].map(value => value * 1000);
    const figure = document.createElement("figure"), label = document.createElement("label"), output = document.createElement("output"), slider = document.createElement("input");
    Object.assign(slider, { type: "range", min: Math.ceil(low), max: Math.floor(high), step: 1, value: middleOf(chosen.first, axis) });
    slider.setAttribute("aria-label", `${title}: place along ${axisNames[axis]}`);
    const name = document.createElement("strong");
    name.textContent = title;
    label.append(name, output, slider);
    const [nU, nV] = [u, v].map(each => Math.ceil((box[each][1] - box[each][0]) / pixel) + 2 * MARGIN_PX);
    const canvases = ["probability", "uncertainty"].map(what => {
      const canvas = document.createElement("canvas");
      Object.assign(canvas, { width: 2 * nU, height: 2 * nV, title: "" });
      canvas.setAttribute("aria-label", `${title} slice: ${what}`);
      canvas.setAttribute("role", "img");
      return canvas;
    });
    const start = [box[u][0] - MARGIN_PX * pixel, sign > 0 ? box[v][0] - MARGIN_PX * pixel : box[v][1] + MARGIN_PX * pixel];
    const pointAt = (x, y) => { const p = [0, 0, 0]; p[axis] = slider.value / 1000; p[u] = start[0] + x * pixel; p[v] = start[1] + sign * y * pixel; return p; };
    const cellAt = (x, y) => toWorld(pointAt(x, y)).map((w, i) => (w - map.low[i]) / map.cell[i]);
    figure.append(label, ...canvases);
    holder.append(figure);
    const view = { axis, u, v, sign, edges, slider, output, canvases, nU, nV, start, pointAt, cellAt, fields: [] };
    slider.addEventListener("input", () => drawOne(view));
    canvases.forEach((canvas, which) => {
      canvas.addEventListener("pointermove", event => {
        const at = canvas.getBoundingClientRect(), value = sample(view.fields[which], cellAt((event.clientX - at.left) / at.width * nU, (event.clientY - at.top) / at.height * nV));
        tell(event, value === null ? "" : which ? `standard deviation ${value.toFixed(2)}` : `probability ${(1 / (1 + Math.exp(-value))).toFixed(3)}`);
      });
      canvas.addEventListener("pointerleave", event => tell(event, ""));
    });
    return view;
  });

  const outline = (pen, view, body) => {
    const { axis, u, v, sign, start } = view, level = view.slider.value / 1000 + 1e-7, { points, faces } = body;
    pen.beginPath();
    for (let f = 0; f < faces.length; f += 3) {
      const ends = [];
      for (let e = 0; e < 3; e++) {
        const a = 3 * faces[f + e], b = 3 * faces[f + (e + 1) % 3], da = points[a + axis] - level, db = points[b + axis] - level;
        if (da < 0 === db < 0) continue;
        const t = da / (da - db);
        ends.push([u, v].map((each, i) => 2 * ((points[a + each] + t * (points[b + each] - points[a + each]) - start[i]) * (i ? sign : 1)) / pixel));
      }
      if (ends.length === 2) { pen.moveTo(...ends[0]); pen.lineTo(...ends[1]); }
    }
    pen.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue(body.colour);
    pen.lineWidth = body.box === "slice-truth" ? 3 : 1.5;
    pen.stroke();
  };
  const drawOne = view => {
    const { nU, nV, canvases, cellAt } = view, { map, history, least, most, deviations } = chosen;
    const [ground, strong, ink, soft] = ["--view-top", chosen.colour, "--ink", "--soft"].map(rgb);
    const fields = [history.fieldAt(map.steps.findLastIndex(kept => kept <= step)), deviations];
    view.fields = fields;
    const origin = cellAt(0, 0), across = cellAt(1, 0).map((value, i) => value - origin[i]), down = cellAt(0, 1).map((value, i) => value - origin[i]);
    canvases.forEach((canvas, which) => {
      const image = new ImageData(nU, nV), tone = which ? ink : strong;
      for (let y = 0; y < nV; y++) for (let x = 0; x < nU; x++) {
        const value = fields[which] ? sample(fields[which], origin.map((o, i) => o + x * across[i] + y * down[i])) : null;
        if (value === null) continue;
        const share = which ? 0.85 * (value - least) / Math.max(most - least, 1e-9) : 1 / (1 + Math.exp(-value)), at = 4 * (y * nU + x);
        for (let c = 0; c < 3; c++) image.data[at + c] = ground[c] + share * (tone[c] - ground[c]);
        image.data[at + 3] = 255;
      }
      const small = document.createElement("canvas"), pen = canvas.getContext("2d");
      [small.width, small.height] = [nU, nV];
      small.getContext("2d").putImageData(image, 0, 0);
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.drawImage(small, 0, 0, canvas.width, canvas.height);
      for (const body of bodies) if (!body.box || document.getElementById(body.box).checked) outline(pen, view, body);
      pen.fillStyle = `rgb(${soft[0]}, ${soft[1]}, ${soft[2]})`;
      pen.font = "20px sans-serif";
      [pen.textBaseline, pen.textAlign] = ["middle", "left"];
      pen.fillText(view.edges[0], 3, nV);
      pen.textAlign = "right"; pen.fillText(view.edges[1], 2 * nU - 3, nV);
      pen.textAlign = "center"; pen.fillText(view.edges[2], nU, 12); pen.fillText(view.edges[3], nU, 2 * nV - 12);
    });
    view.output.textContent = `${axisNames[view.axis].split(",")[0]} = ${view.slider.value} mm`;
  };
  let wanted = false;
  const draw = () => {
    if (wanted || !isNear) return;
    wanted = true;
    requestAnimationFrame(() => { wanted = false; views.forEach(drawOne); });
  };
  for (const id of ["slice-truth", "slice-structures"]) document.getElementById(id).addEventListener("change", draw);
  document.getElementById("slice-structures").parentElement.hidden = !data.structures.length;
  document.getElementById("slice-truth").parentElement.hidden = !bodies.some(body => body.box === "slice-truth");
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  const choice = document.getElementById("slice-class");
  const choose = index => {
    chosen = classes[index];
    document.getElementById("deviation-range").textContent = `${chosen.least.toFixed(2)} to ${chosen.most.toFixed(2)}`;
    document.getElementById("slice-tone").classList.toggle("tone-second", index > 0);
    draw();
  };
  if (choice) choice.addEventListener("change", () => {
    // What was chosen is looked at where the first of its bodies lies.
    for (const view of views) view.slider.value = middleOf(classes[choice.selectedIndex].first, view.axis);
    choose(choice.selectedIndex);
  });
  choose(0);
  // Nobody looks at them before they are scrolled to.
  new IntersectionObserver(([entry]) => { isNear = entry.isIntersecting; draw(); }, { rootMargin: "200px" }).observe(section);
  return { setStep: wantedStep => { step = wantedStep; draw(); } };
};
