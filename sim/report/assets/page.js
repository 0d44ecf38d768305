"use strict";
// This script brings the slider, the curves, the frames and the view together.
(async () => {
  const began = performance.now();
  const read = id => { const element = document.getElementById(id); return element ? JSON.parse(element.textContent) : null; };
  const data = read("data"), readings = read("readings");
  const slider = document.getElementById("slider"), number = document.getElementById("number"), told = document.getElementById("told");
  const play = document.getElementById("play"), picture = document.getElementById("frame"), last = Number(slider.max);

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
    const { points, texts } = JSON.parse(svg.dataset.follow);
    const output = document.querySelector(`output[data-value="${svg.dataset.chart}"]`);
    const actionAt = event => nearest(svg, points, event) + 1;
    svg.addEventListener("pointerdown", event => { stop(); svg.setPointerCapture(event.pointerId); setStep(actionAt(event)); });
    svg.addEventListener("pointermove", event => {
      const action = actionAt(event);
      if (svg.hasPointerCapture(event.pointerId)) setStep(action);
      tell(event, `after action ${action}: ${texts[action - 1]}`);
    });
    svg.addEventListener("pointerleave", event => tell(event, ""));
    return { points, texts, output, cursor: svg.querySelector(".cursor"), now: svg.querySelector(".now") };
  });

  for (const svg of document.querySelectorAll("svg[data-hover]")) {
    const { points, texts } = JSON.parse(svg.dataset.hover);
    svg.addEventListener("pointermove", event => tell(event, texts[nearest(svg, points, event)]));
    svg.addEventListener("pointerleave", event => tell(event, ""));
  }

  // Each frame is text until it is shown.
  const lastPicture = picture && { step: Number(picture.dataset.step), src: picture.src };
  const showFrame = wanted => {
    if (Number(picture.dataset.step) === wanted) return;
    const held = document.getElementById(`frame-${wanted}`);
    const src = wanted === lastPicture.step ? lastPicture.src : held && held.textContent;
    // Without a source the page is still being read.
    if (!src) return;
    picture.src = src;
    picture.dataset.step = wanted;
  };

  let view = null, slices = null, step = last, timer = null;
  const isCalm = matchMedia("(prefers-reduced-motion: reduce)");
  const playMs = () => Math.max(60, Math.min(700, 24000 / last));
  // The arm is seen on its way where the page goes on to the next action.
  const setStep = wanted => {
    const before = step;
    step = Math.min(Math.max(wanted, 0), last);
    slider.value = step;
    number.textContent = `${step} of ${last}`;
    slider.setAttribute("aria-valuetext", step ? `after action ${step}` : "before the first action");
    const row = readings[step] || {};
    told.textContent = step === 0 ? "Before the first action" : Object.entries(row).filter(([name]) => name !== "Action").map(([name, value]) => `${name} ${value}`).join("  ·  ");
    for (const { points, texts, output, cursor, now } of charts) {
      const point = step ? points[step - 1] : null;
      for (const mark of [cursor, now]) mark.style.visibility = point ? "visible" : "hidden";
      if (point) {
        cursor.setAttribute("x1", point[0]); cursor.setAttribute("x2", point[0]);
        now.setAttribute("cx", point[0]); now.setAttribute("cy", point[1]);
      }
      if (output) output.textContent = step ? texts[step - 1] : "–";
    }
    if (picture) showFrame(data.frames.filter(at => at <= step).pop() ?? data.frames[0]);
    if (view) view.setStep(step, step === before + 1 && !isCalm.matches ? 0.8 * playMs() : 0);
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
    if (event.altKey || event.ctrlKey || event.metaKey || target.closest("input[type=range]:not(#slider)")) return;
    const moves = { ArrowRight: step + 1, ArrowLeft: step - 1, Home: 0, End: last };
    if (target === slider) Object.assign(moves, { ArrowUp: step + 1, ArrowDown: step - 1, PageUp: step + 10, PageDown: step - 10 });
    if (event.key in moves) { event.preventDefault(); stop(); setStep(moves[event.key]); }
    else if (event.key === " " && !target.closest("summary, button, input[type=checkbox]")) { event.preventDefault(); toggle(); }
  });

  const unpack = async () => {
    const text = document.getElementById("packed").textContent;
    const letters = atob(text), bytes = new Uint8Array(letters.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = letters.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const buffer = await new Response(stream).arrayBuffer();
    const kinds = { uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, uint32: Uint32Array, int16: Int16Array, float32: Float32Array };
    return place => new kinds[place.kind](buffer, place.at, place.n);
  };

  const addLegend = () => {
    const legend = document.getElementById("legend");
    for (const [name, text, group, colour, names] of view.layers) {
      const label = document.createElement("label"), box = document.createElement("input"), swatch = document.createElement("i");
      box.type = "checkbox"; box.checked = group.visible; box.name = name;
      box.addEventListener("change", () => { group.visible = box.checked; view.request(); });
      label.append(box);
      if (colour) { swatch.className = colour; label.append(swatch); }
      label.append(text);
      if (names) label.title = names;
      legend.append(label);
    }
    if (!data.view.map) return;
    const label = document.createElement("label"), range = document.createElement("input"), output = document.createElement("output");
    label.className = "level";
    Object.assign(range, { type: "range", min: 0.05, max: 0.95, step: 0.05, value: data.view.map.called_from, name: "level" });
    const tell = () => { output.textContent = Number(range.value).toFixed(2); };
    range.addEventListener("input", () => { tell(); view.setLevel(Number(range.value)); });
    tell();
    label.append("Map from probability", range, output);
    legend.append(label);
  };

  let error = null;
  setStep(last);
  const array = await unpack(), target = data.view.target;
  const histories = { map: data.view.map && mapHistory(data.view.map, array), target: target && target.map && mapHistory(target.map, array) };
  if (histories.map) slices = makeSlices(data.view, array, histories.map, tell);
  try {
    view = makeView(data.view, array, histories, setStep);
    addLegend();
    for (const button of document.querySelectorAll("[data-preset]")) button.addEventListener("click", () => {
      view.presets[button.dataset.preset]();
      // From above, the arm would hide the organ.
      const box = document.querySelector("#legend input[name=arm]");
      if (box && box.checked === (button.dataset.preset === "top")) box.click();
    });
    setStep(last);
    view.renderNow();
  } catch (problem) {
    error = String(problem);
    document.getElementById("presets").hidden = true;
    const note = document.createElement("p");
    note.className = "without";
    note.textContent = `The three-dimensional view could not be drawn (${problem.message || problem}). It needs WebGL; everything else on this page works without it.`;
    document.getElementById("view").append(note);
  }
  window.soundingReport = { setStep, error, drawnMs: performance.now() - began, sinceLoadMs: performance.now(), get state() { return view && view.state; } };
})();
