"use strict";
(() => {
  const BLINK_MS = 600;
  const get = (id) => document.getElementById(id);
  const data = JSON.parse(get("data").textContent);

  // whatever is folded away is on paper too
  const folded = [...document.querySelectorAll("details")];
  addEventListener("beforeprint", () => folded.forEach((one) => { one.open = true; }));
  addEventListener("afterprint", () => folded.forEach((one) => { one.open = false; }));

  if (!data.frames.length) return;
  const figures = [...document.querySelectorAll("#figures .frame")];
  const stage = get("stage"), under = get("under"), over = get("over"), edge = get("edge");
  const slider = get("frame"), wipe = get("wipe"), blink = get("blink"), cross = get("cross");
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let shown = 0, beside = "", timer = 0, swapped = null, point = null;

  // orders: see OrderMap in the package
  const unpacked = new Map();
  async function orders(frame, name) {
    const map = frame[name];
    if (!map) return null;
    const bytes = Uint8Array.from(atob(map.data), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const parts = new Uint8Array(await new Response(stream).arrayBuffer());
    const size = frame.rows * frame.cols, found = new Float64Array(size);
    for (let row = 0; row < frame.rows; row++) {
      let level = 0;
      for (let at = row * frame.cols; at < (row + 1) * frame.cols; at++) {
        level = (level + parts[at] + 256 * parts[size + at]) & 65535;
        found[at] = level ? (level - 1 + map.first) * map.step : NaN;
      }
    }
    return found;
  }
  function mapsOf(number) {
    const frame = data.frames[number];
    if (!unpacked.has(number)) {
      unpacked.set(number, Promise.all([orders(frame, "order"), orders(frame, "model_order")]));
    }
    return unpacked.get(number);
  }

  const digits = (map) => Math.round(-Math.log10(map.step));
  const fringes = (value, map) => (Number.isNaN(value) ? "not known" : value.toFixed(digits(map)));
  async function read() {
    if (!point) return;
    const frame = data.frames[shown], { row, col } = point, number = shown;
    const [order, model] = await mapsOf(number);
    if (number !== shown || !point || point.row !== row || point.col !== col) return;
    const at = row * frame.cols + col, parts = [];
    if (order) parts.push("N = " + fringes(order[at], frame.order) + (Number.isNaN(order[at]) ? "" : " fringes"));
    else parts.push("N: no order was read in this frame");
    if (model) parts.push("simulation " + fringes(model[at], frame.model_order));
    if (order && model && !Number.isNaN(order[at] + model[at])) {
      parts.push("difference " + fringes(order[at] - model[at], frame.order));
    }
    const ownRow = frame.first + frame.stride * row, ownCol = frame.first + frame.stride * col;
    if (frame.pixel_mm !== null) {
      parts.push("x = " + (frame.left_mm + (ownCol + 0.5) * frame.pixel_mm).toFixed(4) + " mm");
      parts.push("z = " + (frame.top_mm + (ownRow + 0.5) * frame.pixel_mm).toFixed(4) + " mm");
    } else parts.push("x, z: no pixel scale is known");
    parts.push("row " + ownRow + ", column " + ownCol);
    get("readout").textContent = parts.join("; ");
  }

  function drawCross() {
    const frame = data.frames[shown];
    cross.hidden = !point;
    if (!point) return;
    cross.style.left = (100 * (point.col + 0.5)) / frame.cols + "%";
    cross.style.top = (100 * (point.row + 0.5)) / frame.rows + "%";
  }
  function moveTo(row, col) {
    const frame = data.frames[shown];
    point = {
      row: Math.min(Math.max(row, 0), frame.rows - 1),
      col: Math.min(Math.max(col, 0), frame.cols - 1),
    };
    drawCross();
    read();
  }
  function pointAt(event) {
    const box = under.getBoundingClientRect(), frame = data.frames[shown];
    if (!box.width || !box.height) return;
    moveTo(
      Math.floor(((event.clientY - box.top) / box.height) * frame.rows),
      Math.floor(((event.clientX - box.left) / box.width) * frame.cols),
    );
  }

  function drawWipe() {
    const share = swapped === null ? Number(wipe.value) : swapped ? 100 : 0;
    over.style.clipPath = "inset(0 " + (100 - share) + "% 0 0)";
    edge.style.left = share + "%";
    edge.hidden = swapped !== null || share === 0 || share === 100;
  }
  function show() {
    const frame = data.frames[shown], pictures = figures[shown].querySelectorAll(".pane > img");
    const keys = frame.panes.map((pane) => pane.key);
    const at = Math.max(keys.indexOf(beside), Math.min(1, keys.length - 1));
    over.src = pictures[0].src;
    under.src = pictures[at].src;
    over.alt = pictures[0].alt;
    under.alt = pictures[at].alt;
    under.width = frame.cols;
    under.height = frame.rows;
    get("under-label").textContent = frame.panes[at].label;
    document.querySelectorAll(".over-label").forEach((one) => { one.textContent = frame.panes[0].label; });
    const legend = figures[shown].querySelectorAll(".pane .legend")[at];
    const [low, high] = legend.querySelectorAll("span"), bar = legend.querySelector("img");
    get("low").textContent = low.textContent;
    get("high").textContent = high.textContent;
    get("bar").src = bar.src;
    get("bar").alt = bar.alt;
    const why = frame.why && " (" + frame.why + ")";
    const notes = frame.notes.map((note) => "; " + note).join("");
    get("frame-label").textContent = "frame " + frame.number + ": " + frame.label + why + notes;
    slider.setAttribute("aria-valuetext", "frame " + frame.number + ", " + frame.label);
    if (point) moveTo(point.row, point.col);
    drawWipe();
  }

  function stop() {
    clearInterval(timer);
    timer = 0;
    swapped = null;
    blink.setAttribute("aria-pressed", "false");
    drawWipe();
  }
  const swap = () => { swapped = !swapped; drawWipe(); };
  blink.addEventListener("click", () => {
    if (calm.matches) { // nothing moves by itself: each press shows the other picture
      swapped = swapped === null ? true : !swapped;
      blink.setAttribute("aria-pressed", String(swapped));
      drawWipe();
    } else if (timer) stop();
    else {
      blink.setAttribute("aria-pressed", "true");
      swap();
      timer = setInterval(swap, BLINK_MS);
    }
  });
  slider.addEventListener("input", () => { shown = Number(slider.value); show(); });
  wipe.addEventListener("input", () => { if (swapped !== null) stop(); drawWipe(); });
  stage.addEventListener("pointermove", pointAt);
  stage.addEventListener("pointerdown", pointAt);
  const STEPS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
  stage.addEventListener("keydown", (event) => {
    const step = STEPS[event.key];
    if (!step) return;
    event.preventDefault();
    const frame = data.frames[shown], by = event.shiftKey ? 10 : 1;
    const from = point || { row: Math.floor(frame.rows / 2), col: Math.floor(frame.cols / 2) };
    moveTo(from.row + by * step[0], from.col + by * step[1]);
  });

  const choices = new Map();
  data.frames.forEach((frame) => frame.panes.slice(1).forEach((p) => choices.set(p.key, p.label)));
  choices.forEach((label, key) => {
    const box = document.createElement("label"), button = document.createElement("input");
    button.type = "radio";
    button.name = "beside";
    button.checked = !beside;
    beside = beside || key;
    button.addEventListener("change", () => { beside = key; show(); });
    box.append(button, " " + label);
    get("choices").append(box);
  });

  get("viewer").hidden = false;
  document.documentElement.classList.add("live");
  blink.textContent = calm.matches ? "Swap" : "Blink";
  show();
})();
