"use strict";
// This script brings the slider, the curves, the frames and the view together. A page may hold several runs, which the
// slider moves together: what belongs to a run after the first has its number behind its name.
(async () => {
  const began = performance.now();
  const runs = [...document.querySelectorAll("script[data-run]")].map((_, i) => {
    const part = name => document.getElementById(i ? `${name}-${i}` : name);
    return { part, data: JSON.parse(part("data").textContent), readings: JSON.parse(part("readings").textContent), told: part("told"), view: null };
  });
  const { data } = runs[0], views = () => runs.map(run => run.view).filter(Boolean);
  const slider = document.getElementById("slider"), number = document.getElementById("number");
  const play = document.getElementById("play"), last = Number(slider.max);

  // A text beside the pointer.
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;
  document.body.append(tip);
  const tell = (event, text) => {
    tip.hidden = !text;
    if (!text) return;
    tip.textContent = text;
    const left = Math.min(event.clientX + 12, innerWidth - tip.offsetWidth - 8);
    tip.style.transform = `translate(${left}px, ${Math.max(event.clientY - tip.offsetHeight - 10, 4)}px)`;
  };

  const nearest = (svg, points, event) => {
    const at = svg.createSVGPoint();
    [at.x, at.y] = [event.clientX, event.clientY];
    const x = at.matrixTransform(svg.getScreenCTM().inverse()).x;
    let best = 0;
    points.forEach((point, i) => { if (point && (!points[best] || Math.abs(point[0] - x) < Math.abs(points[best][0] - x))) best = i; });
    return best;
  };
  const charts = [...document.querySelectorAll("svg[data-follow]")].map(svg => {
    const curves = JSON.parse(svg.dataset.follow), longest = curves.reduce((a, b) => b.points.length > a.points.length ? b : a).points;
    const outputs = document.querySelectorAll(`output[data-value="${svg.dataset.chart}"]`), marks = svg.querySelectorAll(".now");
    const actionAt = event => nearest(svg, longest, event) + 1;
    svg.addEventListener("pointerdown", event => { stop(); svg.setPointerCapture(event.pointerId); setStep(actionAt(event)); });
    svg.addEventListener("pointermove", event => {
      const action = actionAt(event);
      if (svg.hasPointerCapture(event.pointerId)) setStep(action);
      tell(event, `after action ${action}: ${curves.map(({ texts }) => texts[action - 1] ?? "–").join(", ")}`);
    });
    svg.addEventListener("pointerleave", event => tell(event, ""));
    return { curves: curves.map((curve, i) => ({ ...curve, output: outputs[i], now: marks[i] })), longest, cursor: svg.querySelector(".cursor") };
  });

  for (const svg of document.querySelectorAll("svg[data-hover]")) {
    const { points, texts } = JSON.parse(svg.dataset.hover);
    svg.addEventListener("pointermove", event => tell(event, texts[nearest(svg, points, event)]));
    svg.addEventListener("pointerleave", event => tell(event, ""));
  }

  // Each picture is text until it is shown.
  const pictures = [["frame", data.frames], ["bmode", data.bmodes]].map(([name, steps]) => {
    const element = document.getElementById(name);
    return { name, steps, element, last: element && { step: Number(element.dataset.step), src: element.src } };
  }).filter(each => each.element);
  const showPicture = ({ name, steps, element, last }, step) => {
    const wanted = steps.filter(at => at <= step).pop() ?? steps[0];
    if (Number(element.dataset.step) === wanted) return;
    const held = document.getElementById(`${name}-${wanted}`);
    const src = wanted === last.step ? last.src : held && held.textContent;
    // Without a source the page is still being read.
    if (!src) return;
    element.src = src;
    element.dataset.step = wanted;
  };

  let slices = null, step = last, timer = null;
  const isCalm = matchMedia("(prefers-reduced-motion: reduce)");
  const playMs = () => Math.max(60, Math.min(700, 24000 / last));
  // The arm is seen on its way where the page goes on to the next action.
  const setStep = wanted => {
    const before = step, at = (run, wanted) => Math.min(wanted, run.readings.length - 1);
    step = Math.min(Math.max(wanted, 0), last);
    slider.value = step;
    number.textContent = `${step} of ${last}`;
    slider.setAttribute("aria-valuetext", step ? `after action ${step}` : "before the first action");
    for (const run of runs) {
      const own = at(run, step), facts = Object.entries(run.readings[own] || {}).map(([name, value]) => `${name} ${value}`);
      if (own < step) facts.unshift(`Ended after ${own}`);
      run.told.textContent = own ? facts.join("  ·  ") : "Before the first action";
    }
    for (const { curves, longest, cursor } of charts) {
      const line = step && longest[step - 1];
      cursor.style.visibility = line ? "visible" : "hidden";
      if (line) { cursor.setAttribute("x1", line[0]); cursor.setAttribute("x2", line[0]); }
      // A run that ended before keeps its last value.
      for (const { points, texts, output, now } of curves) {
        const own = Math.min(step, points.length), point = own ? points[own - 1] : null;
        now.style.visibility = point ? "visible" : "hidden";
        if (point) { now.setAttribute("cx", point[0]); now.setAttribute("cy", point[1]); }
        if (output) output.textContent = own ? texts[own - 1] : "–";
      }
    }
    for (const each of pictures) showPicture(each, step);
    for (const run of runs) {
      const own = at(run, step), isNext = own === at(run, before) + 1;
      if (run.view) run.view.setStep(own, isNext && !isCalm.matches ? 0.8 * playMs() : 0);
    }
    if (slices) slices.setStep(step);
  };

  const stop = () => { clearInterval(timer); timer = null; play.classList.remove("playing"); play.setAttribute("aria-label", "Play"); };
  const toggle = () => {
    if (timer) return stop();
    if (step >= last) setStep(0);
    play.classList.add("playing");
    play.setAttribute("aria-label", "Pause");
    timer = setInterval(() => { if (step >= last) stop(); else setStep(step + 1); }, playMs());
  };
  play.addEventListener("click", toggle);
  slider.addEventListener("input", () => { stop(); setStep(Number(slider.value)); });
  document.addEventListener("keydown", event => {
    const target = event.target;
    // Other sliders have the same keys, and what can be pressed has the space bar.
    if (event.altKey || event.ctrlKey || event.metaKey || target.closest("input[type=range]:not(#slider), select")) return;
    const moves = { ArrowRight: step + 1, ArrowLeft: step - 1, Home: 0, End: last };
    if (target === slider) Object.assign(moves, { ArrowUp: step + 1, ArrowDown: step - 1, PageUp: step + 10, PageDown: step - 10 });
    if (event.key in moves) { event.preventDefault(); stop(); setStep(moves[event.key]); }
    else if (event.key === " " && !target.closest("summary, button, input[type=checkbox]")) { event.preventDefault(); toggle(); }
  });

  const unpack = async run => {
    const text = run.part("packed").textContent;
    const letters = atob(text), bytes = new Uint8Array(letters.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = letters.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const buffer = await new Response(stream).arrayBuffer();
    const kinds = { uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, uint32: Uint32Array, int16: Int16Array, float32: Float32Array };
    return place => new kinds[place.kind](buffer, place.at, place.n);
  };

  // The legend switches a layer of all runs.
  const addLegend = () => {
    const legend = document.getElementById("legend"), names = [...new Set(views().flatMap(view => view.layers.map(([name]) => name)))];
    for (const name of names) {
      const layers = views().flatMap(view => view.layers.filter(each => each[0] === name)), [[, text, first, colour, title]] = layers;
      const label = document.createElement("label"), box = document.createElement("input"), swatch = document.createElement("i");
      box.type = "checkbox"; box.checked = first.visible; box.name = name;
      box.addEventListener("change", () => { for (const [, , group] of layers) group.visible = box.checked; for (const view of views()) view.request(); });
      label.append(box);
      if (colour) { swatch.className = colour; label.append(swatch); }
      label.append(text);
      if (title) label.title = title;
      legend.append(label);
    }
    const from = [...new Set(runs.filter(run => run.data.view.map).map(run => run.data.view.map.called_from))];
    if (!from.length) return;
    const label = document.createElement("label"), range = document.createElement("input"), output = document.createElement("output");
    label.className = "level";
    Object.assign(range, { type: "range", min: 0.05, max: 0.95, step: 0.05, value: from[0], name: "level" });
    range.addEventListener("input", () => { output.textContent = Number(range.value).toFixed(2); for (const view of views()) view.setLevel(Number(range.value)); });
    // Maps of two priors are cut at two probabilities, until one is chosen.
    output.textContent = from.map(each => each.toFixed(2)).join(" and ");
    label.append("Map from probability", range, output);
    legend.append(label);
  };

  const draw = async run => {
    const array = await unpack(run), target = run.data.view.target;
    const histories = { map: run.data.view.map && mapHistory(run.data.view.map, array), target: target && target.map && mapHistory(target.map, array) };
    if (histories.map && document.getElementById("slices")) slices = makeSlices(run.data.view, array, histories, tell);
    // The runs are looked at from one place.
    run.view = makeView(run.data.view, array, histories, { part: run.part, onPick: setStep, onLook: look => { for (const other of views()) if (other !== run.view) other.lookAs(look); } });
  };
  let error = null;
  setStep(last);
  try {
    for (const run of runs) await draw(run);
    addLegend();
    for (const button of document.querySelectorAll("[data-preset]")) button.addEventListener("click", () => {
      for (const view of views()) view.presets[button.dataset.preset]();
      // From above, the arm would hide the organ.
      const box = document.querySelector("#legend input[name=arm]");
      if (box && box.checked === (button.dataset.preset === "top")) box.click();
    });
    setStep(last);
    for (const view of views()) view.renderNow();
  } catch (problem) {
    error = String(problem);
    for (const { part } of runs) {
      part("presets").hidden = true;
      const note = document.createElement("p");
      note.className = "without";
      note.textContent = `The three-dimensional view could not be drawn (${problem.message || problem}). It needs WebGL; everything else on this page works without it.`;
      part("view").append(note);
    }
  }
  const states = () => runs.map(run => run.view && run.view.state);
  window.soundingReport = { setStep, error, drawnMs: performance.now() - began, sinceLoadMs: performance.now(), get state() { return states()[0]; }, get states() { return states(); } };
})();
