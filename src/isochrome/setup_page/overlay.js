/* What lies over the picture: the model's fringes as sliders move, or the map of known orders. */
const BLINK_MS = 600, SPAN_PX = 0.25;
const calm = matchMedia("(prefers-reduced-motion: reduce)");
const overlay = { values: {}, busy: false, again: false, serial: 0, timer: 0, hidden: false };

function drawOver(to) {
  drawMapOrModel(to);
  drawPreview(to);
}
function drawMapOrModel(to) {
  const own = shown.map || (get("show-model").checked ? shown.model : null);
  if (!own || overlay.hidden) return;
  const cut = shown.map || overlay.timer ? 100 : Number(get("wipe").value);
  to.save();
  to.beginPath();
  to.rect(own.left, own.top, (own.cols * cut) / 100, own.rows);
  to.clip();
  // the map's colours let the fringes through, however opaque they are to be
  to.globalAlpha = ((shown.map ? 0.75 : 1) * Number(get("opacity").value)) / 100;
  to.drawImage(own.picture, own.left, own.top);
  to.restore();
  if (cut > 0 && cut < 100) {
    to.fillStyle = "#ff9d2e";
    to.fillRect(own.left + (own.cols * cut) / 100, own.top, 1.5 / view.zoom, own.rows);
  }
}

/* one request at a time; the newest values are asked for when it is back */
async function askModel() {
  if (!get("show-model").checked || !page.state || !page.state.model) return;
  if (overlay.busy) { overlay.again = true; return; }
  overlay.busy = true;
  try {
    do {
      overlay.again = false;
      const serial = ++overlay.serial;
      const answer = await fetch("model", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ frame: page.frame, values: overlay.values }),
      });
      if (!answer.ok) {
        shown.model = null;
        say((await answer.json()).error, true);
        draw();
        continue;
      }
      const size = (name) => Number(answer.headers.get(name));
      const rows = size("X-Rows"), cols = size("X-Cols"), bytes = new Uint8Array(await answer.arrayBuffer());
      shown.model = { picture: bitmap(bytes, rows, cols, GREYS), rows, cols, top: size("X-Top"), left: size("X-Left"), serial };
      draw();
    } while (overlay.again);
  } catch (error) {
    lost(error);
  } finally {
    overlay.busy = false;
  }
}

const SLIDERS = [
  { key: "load.normal_n", words: "Load (N)", factor: 3 },
  { key: "friction.coefficient", words: "Friction coefficient", low: -1, high: 1 },
  { key: "specimen.fringe_value_n_per_mm", words: "Fringe value f_sigma (N/mm per fringe)", factor: 3 },
  { key: "camera.left_mm", words: "Place along x: left edge (mm)", along: "cols" },
  { key: "camera.top_mm", words: "Place in depth: upper edge (mm)", along: "rows" },
  { key: "camera.roll_deg", words: "Roll of the camera (degrees)", low: -5, high: 5, absent: 0 },
  { key: "wear.coefficient_mm2_per_n", words: "Wear coefficient (mm²/N)", factor: 3 },
];
function showSliders(state) {
  const holder = get("sliders"), had = document.activeElement;
  const kept = had && holder.contains(had) ? had.id : null;
  holder.replaceChildren();
  overlay.values = {};
  if (!state.model) {
    holder.textContent = kindOf(state) === "other"
      ? "There is no model of something else: its orders are told by known points, known lines and free edges, in step 2."
      : "The scene has no model yet: fill in step 1.";
    return;
  }
  if (!state.pixel_mm) {
    holder.textContent = "The scale is not known yet: set it with the tool Scale. Of a disc or ring the fit finds it by the rim.";
    return;
  }
  for (const one of SLIDERS) {
    const value = sliderStart(one, state);
    if (value !== null) holder.append(slider(one, value, state));
  }
  if (kept && get(kept)) get(kept).focus();
}
function sliderStart(one, state) {
  const stated = state.values[one.key];
  if (typeof stated === "number") return stated;
  if (stated !== undefined) return null; // a table over distance
  if (one.absent !== undefined) return one.absent;
  if (!one.along || !state.place) return null;
  // where the scene does not say it, the contact is in the middle of the picture's width
  const at = one.along === "cols" ? state.place[1] - state.region.left_px : state.place[0] - state.region.top_px;
  return -(at + 0.5) * state.pixel_mm;
}
function sliderEnds(one, value, state) {
  if (one.factor) return [value / one.factor, value * one.factor];
  if (one.along) {
    const reach = SPAN_PX * state.region[one.along === "cols" ? "width_px" : "height_px"] * state.pixel_mm;
    return [value - reach, value + reach];
  }
  return [Math.min(one.low, value), Math.max(one.high, value)];
}
function slider(one, value, state) {
  const row = document.createElement("div"), label = document.createElement("label");
  const bar = document.createElement("input"), number = document.createElement("input");
  const [low, high] = sliderEnds(one, value, state);
  row.className = "slider";
  bar.type = "range";
  bar.id = "slide-" + one.key;
  bar.min = low;
  bar.max = high;
  bar.step = (high - low) / 1000;
  bar.value = value;
  label.htmlFor = bar.id;
  label.textContent = one.words;
  number.type = "text";
  number.inputMode = "decimal";
  number.id = "number-" + one.key;
  number.setAttribute("aria-label", one.words + ", by number");
  number.value = Number(value.toPrecision(6));
  bar.addEventListener("input", () => {
    overlay.values[one.key] = Number(bar.value);
    number.value = Number(Number(bar.value).toPrecision(5));
    askModel();
  });
  const set = (given) => {
    const values = Number.isFinite(given) ? { [one.key]: given } : {};
    if (Number.isFinite(given)) useTool({ tool: "values", values });
    else refusedValue(new Refusal(one.words + ": '" + number.value + "' is no number."));
  };
  bar.addEventListener("change", () => set(Number(Number(bar.value).toPrecision(5))));
  number.addEventListener("change", () => set(Number(number.value.replace(",", "."))));
  row.append(label, bar, number);
  return row;
}

function stopBlink() {
  clearInterval(overlay.timer);
  overlay.timer = 0;
  overlay.hidden = false;
  get("blink").setAttribute("aria-pressed", "false");
  draw();
}
const swap = () => { overlay.hidden = !overlay.hidden; draw(); };
get("blink").addEventListener("click", () => {
  if (calm.matches) { // nothing moves by itself: each press shows the other picture
    swap();
    get("blink").setAttribute("aria-pressed", String(overlay.hidden));
  } else if (overlay.timer) stopBlink();
  else {
    get("blink").setAttribute("aria-pressed", "true");
    overlay.timer = setInterval(swap, BLINK_MS);
    swap();
  }
});
for (const id of ["opacity", "wipe"]) get(id).addEventListener("input", draw);
get("show-model").addEventListener("change", () => { draw(); askModel(); });

/* what lies over the picture can be compared only where something does */
function showOver(state) {
  for (const id of ["show-model", "wipe", "blink"]) get(id).disabled = !state.model;
  get("opacity").disabled = !state.model && !shown.map;
}

let mapAsked = 0, mapWanted = false;
async function askMap() {
  const mine = ++mapAsked;
  mapWanted = true;
  say("Reading what the points say …");
  try {
    const answer = await fetch("map", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ frame: page.frame }),
    });
    if (mine !== mapAsked) return; // the points, or the frame, are others by now
    if (!answer.ok) { say((await answer.json()).error, true); return; }
    const size = (name) => Number(answer.headers.get(name));
    const rows = size("X-Rows"), cols = size("X-Cols"), bytes = new Uint8Array(await answer.arrayBuffer());
    if (mine !== mapAsked) return;
    shown.map = { picture: bitmap(bytes, rows, cols, ORDERS), orders: bytes, rows, cols, top: size("X-Top"), left: size("X-Left") };
    get("hide-map").hidden = false;
    showOver(page.state);
    const known = bytes.reduce((count, level) => count + (level > 0), 0);
    const said = JSON.parse(answer.headers.get("X-Said"));
    say("Coloured is what the points say: the order is known in " + Math.round((100 * known) / bytes.length) + " % of the region.");
    const { top_px: top, left_px: left } = page.state.region;
    if (said.length && (top || left)) said.push("Rows and columns here are counted in the region: add " + top + " and " + left + " for those of the picture.");
    get("map-said").replaceChildren(...said.map((text) => {
      const one = document.createElement("p");
      one.textContent = text;
      return one;
    }));
    draw();
  } catch (error) { lost(error); }
}
/* the order at a point of the picture as the map has it, in words; see bitmap's ORDERS */
function orderOnMap(at) {
  const { orders, rows, cols, top, left } = shown.map, row = Math.round(at.row) - top, col = Math.round(at.col) - left;
  if (row < 0 || col < 0 || row >= rows || col >= cols) return "";
  const level = orders[row * cols + col];
  if (!level) return "N not known";
  return level === 255 ? "N over 5.07" : "N = " + ((level - 1) * 0.02).toFixed(2);
}
/* another text has another map; it is asked for by itself where what was told on the picture changed */
function renewMap(before, state) {
  const wanted = mapWanted;
  hideMap();
  const told = (one) => JSON.stringify([one.known_order, one.known_line, one.free_boundary, one.polygon, one.region]);
  mapWanted = wanted;
  if (wanted && before && told(before) !== told(state)) askMap();
}
function hideMap() {
  shown.map = null;
  mapAsked++;
  mapWanted = false;
  get("map-said").replaceChildren();
  get("hide-map").hidden = true;
  if (page.state) showOver(page.state);
  draw();
}
get("show-map").addEventListener("click", askMap);
get("hide-map").addEventListener("click", hideMap);
