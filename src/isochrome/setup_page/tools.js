/* The tools: points on the picture, by the mouse, the keys and number fields alike. */
const WORDS = {
  look: "Drag the picture to move it. Choose a tool above the picture.",
  scale: "Set two points on the ends of a length that you know, and give it in mm.",
  contact: "Click the middle of the contact, on the surface (of a disc, ring or beam: the middle of its top).",
  surface: "Set two points on the surface, far apart: they give its height and the camera's roll.",
  region: "Drag a box around what is to be read. Its corners can be moved.",
  mask: "Click the corners of the specimen, one after the other. Points can be moved; what is outside is not read.",
  order: "Click a point whose order you know: 0 in a free corner, a counted place. It tells the order of all that hangs together with it.",
  line: "Click along a fringe line whose order you know (whole in the dark: 0, 1, 2 …).",
  boundary: "Click along an edge on which nothing presses, corner by corner; a whole outline ends on its first point. At its sharp corners the order is 0.",
  edges: "Set one point on the beam's upper edge and one on its lower edge, one above the other: its height gives the scale.",
  rollers: "Set a point on each of the two inner rollers: their distance gives the scale, and what lies between them is read.",
  rim: "Set three points or more on the disc's rim, far apart: what is read is the square about it.",
};
const MOST = { look: 0, scale: 2, contact: 1, surface: 2, region: 2, mask: 500, order: 200, line: 500, boundary: 500, edges: 2, rollers: 2, rim: 12 };
let tool = "look", active = -1, dragged = null, line = 0;
const touched = {}; // by tool, how often its points were moved since the scene had them
function touch() { touched[tool] = (touched[tool] || 0) + 1; }
const own = {
  scale: [], contact: [], surface: [], region: [], mask: [], order: [], line: [], boundary: [],
  edges: [], rollers: [], rim: [],
};
const ofLines = () => tool === "line" || tool === "boundary"; // tools of several lines

function points() {
  if (tool === "look") return [];
  if (ofLines()) return own[tool][line] ? own[tool][line].points : [];
  return own[tool];
}
/* what the server knows of the scene goes into the tools */
function takeState(state) {
  const point = ([row, col]) => ({ row, col });
  const box = state.region, whole = box.height_px === state.frames.rows && box.width_px === state.frames.cols;
  const known = {
    contact: state.place ? [point(state.place)] : [],
    surface: surfacePoints(state),
    mask: state.polygon.map(point),
    order: state.known_order.map((one) => ({ ...one })),
    line: state.known_line.map((one) => ({ order: one.order, points: one.points.map(point) })),
    boundary: state.free_boundary.map((one) => ({ points: one.points.map(point) })),
    region: whole ? [] : [
      { row: box.top_px, col: box.left_px },
      { row: box.top_px + box.height_px - 1, col: box.left_px + box.width_px - 1 },
    ],
  };
  const isNewLine = ofLines() && line === own[tool].length;
  // what the user has moved since, the answer knows nothing of
  for (const name of Object.keys(known)) if (!touched[name]) own[name] = known[name];
  if (ofLines()) line = Math.min(line, Math.max(0, own[tool].length - (isNewLine ? 0 : 1)));
  active = Math.min(active, points().length - 1);
  showPoints();
  draw();
}
/* the user's own two points where the scene's surface goes through them, else its ends, if it is
   turned; a level one that nobody has set is drawn as a line alone */
function surfacePoints(state) {
  if (!state.surface) return [];
  const [left, right] = state.surface, stated = state.values["camera.roll_deg"] !== undefined;
  const rowAt = (col) => left[0] + ((right[0] - left[0]) * (col - left[1])) / (right[1] - left[1]);
  const isOwn = own.surface.length === 2 && own.surface.every(({ row, col }) => Math.abs(row - rowAt(col)) < NEAR_PX);
  if (isOwn) return own.surface;
  return stated ? state.surface.map(([row, col]) => ({ row, col })) : [];
}
const NEAR_PX = 0.5; // the roll's last digit, and a lens
const pairs = (list) => list.map(({ row, col }) => [row, col]);
const commands = {
  scale: () => null,
  contact: () => own.contact.length && { point: pairs(own.contact)[0] },
  surface: () => own.surface.length === 2 && { points: pairs(own.surface) },
  region: () => {
    if (!own.region.length) return { region: null };
    if (own.region.length < 2) return null;
    const rows = own.region.map((one) => Math.round(one.row)), cols = own.region.map((one) => Math.round(one.col));
    const top = Math.min(...rows), left = Math.min(...cols);
    const box = { top_px: top, left_px: left, height_px: Math.max(...rows) - top + 1, width_px: Math.max(...cols) - left + 1 };
    if (box.height_px > 1 && box.width_px > 1) return { region: box };
    say("The region needs two corners that are apart in height and in width.");
    return null;
  },
  polygon: () => (own.mask.length === 0 || own.mask.length > 2) && { points: pairs(own.mask) },
  known_order: () => ({ points: own.order }),
  known_line: () => own.line.every((one) => one.points.length > 1 && areApart(one.points)) && {
    lines: own.line.map((one) => ({ order: one.order, points: pairs(one.points) })),
  },
  free_boundary: () => own.boundary.every((one) => one.points.length > 1 && areApart(one.points)) && {
    lines: own.boundary.map((one) => ({ points: pairs(one.points) })),
  },
  edges: () => own.edges.length === 2 && { points: pairs(own.edges) },
  rollers: () => own.rollers.length === 2 && { points: pairs(own.rollers) },
  rim: () => own.rim.length > 2 && { points: pairs(own.rim) },
};
const areApart = (list) => list.every(({ row, col }, k) => !k || row !== list[k - 1].row || col !== list[k - 1].col);
const NAMES = { mask: "polygon", order: "known_order", line: "known_line", boundary: "free_boundary" };
const commitLater = {};
function commit(wait = 0) {
  const mine = tool, name = NAMES[tool] || tool;
  if (mine === "look") return;
  touch();
  clearTimeout(commitLater[mine]);
  commitLater[mine] = setTimeout(() => {
    const asked = commands[name](), moves = touched[mine];
    if (asked) useTool({ tool: name, ...asked }, "", () => { if (touched[mine] === moves) delete touched[mine]; });
    else if (keepsLast(mine)) say(NEEDS[mine] + "; the scene keeps the last one.", true);
  }, wait);
}

const NEEDS = { mask: "A mask needs three corners", line: "A line needs two points", boundary: "A free edge needs two points" };
/* whether the scene has a mask or line of which too few points are left here */
function keepsLast(name) {
  if (name === "mask") return page.state.polygon.length > 0;
  if (!(name in NEEDS)) return false;
  const lines = page.state[NAMES[name]];
  return own[name].some((one, number) => one.points.length < 2 && number < lines.length);
}
function inside(point) {
  // the contact and its surface may lie beside the picture, one height of it away at the most
  const beyond = 0.5 + (tool === "contact" || tool === "surface" ? shown.rows : 0);
  return {
    row: Number(clamp(point.row, -beyond, shown.rows - 1 + beyond).toFixed(2)),
    col: Number(clamp(point.col, -beyond, shown.cols - 1 + beyond).toFixed(2)),
  };
}
function addPoint(at) {
  if (tool === "look") return;
  const point = inside(at);
  touch();
  if (tool === "line" && !own.line[line]) {
    own.line[line] = { order: Number(get("new-order").value) || 0, points: [] };
  }
  if (tool === "boundary" && !own.boundary[line]) own.boundary[line] = { points: [] };
  if (tool === "surface" && own.surface.length === MOST.surface) own.surface = []; // a new pair
  const list = points();
  if (list.length >= MOST[tool]) {
    active = tool === "contact" ? 0 : nearest(at, Infinity);
    Object.assign(list[active], point);
  } else {
    if (tool === "order") Object.assign(point, { order: Number(get("new-order").value) || 0, extremum: null });
    active = tool === "mask" && list.length > 2 ? placeInOutline(list, point) : list.length;
    list.splice(active, 0, point);
  }
  showPoints();
  draw();
}
/* without the mouse: in the middle of the view, beside a point that is there already */
function addInView() {
  const at = middleOfView(), list = points();
  while (list.some((one) => Math.hypot(one.row - at.row, one.col - at.col) < 1)) {
    at.row += Math.ceil(16 / view.zoom);
    at.col += Math.ceil(24 / view.zoom);
  }
  addPoint(at);
  commit();
}
/* between which two corners of an outline a new one belongs: where it lengthens it least */
function placeInOutline(list, point) {
  const far = (a, b) => Math.hypot(a.row - b.row, a.col - b.col);
  let best = list.length, least = Infinity;
  list.forEach((from, at) => {
    const to = list[(at + 1) % list.length], more = far(from, point) + far(point, to) - far(from, to);
    if (more < least) { least = more; best = at + 1; }
  });
  return best;
}
function removePoint(at) {
  const list = points();
  if (at < 0 || at >= list.length) return;
  list.splice(at, 1);
  if (ofLines() && !list.length) own[tool].splice(line, 1);
  active = Math.min(at, list.length - 1);
  showPoints();
  draw();
  commit();
}
const farPx = (one, at) => Math.hypot(one.row - at.row, one.col - at.col) * view.zoom;
function nearest(at, reach) {
  let best = -1, least = reach;
  points().forEach((one, number) => {
    const far = farPx(one, at);
    if (far < least) { least = far; best = number; }
  });
  return best;
}
/* the point under the mouse, which may be another line's: that line is the chosen one then */
function grab(at) {
  const here = nearest(at, REACH_PX);
  if (here >= 0 || !ofLines()) return here;
  let least = REACH_PX, chosen = line;
  own[tool].forEach((one, number) => one.points.forEach((point) => {
    const far = farPx(point, at);
    if (far < least) { least = far; chosen = number; }
  }));
  chooseLine(chosen);
  return nearest(at, REACH_PX);
}
/* another line; a new one of which less than two points are set is dropped */
function chooseLine(number) {
  if (number === line) return;
  const lines = own[tool];
  if (line === lines.length - 1 && lines[line].points.length < 2) lines.pop();
  line = number;
  active = points().length ? 0 : -1;
}

canvas.addEventListener("pointerdown", (event) => {
  stage.focus({ preventScroll: true });
  if (!shown.picture) return;
  canvas.setPointerCapture(event.pointerId);
  const at = toPicture(event);
  if (tool === "look" || event.button === 1) {
    dragged = { pan: true, x: event.clientX, y: event.clientY, left: view.left, top: view.top };
    return;
  }
  if (event.button !== 0) return;
  const hit = grab(at);
  if (hit >= 0) active = hit;
  else if (tool === "region") {
    own.region = [];
    addPoint(at);
    addPoint(at);
  } else addPoint(at);
  const one = points()[active];
  dragged = { point: one, row: one.row - at.row, col: one.col - at.col, moved: hit < 0 };
  if (hit < 0) dragged.row = dragged.col = 0;
  showPoints();
  draw();
});
canvas.addEventListener("pointermove", (event) => {
  if (!shown.picture) return;
  const at = toPicture(event);
  readOut(at);
  if (!dragged) return;
  if (dragged.pan) {
    view.left = dragged.left - (event.clientX - dragged.x) / view.zoom;
    view.top = dragged.top - (event.clientY - dragged.y) / view.zoom;
    view.fitted = false;
    keepInSight();
    return;
  }
  touch();
  Object.assign(dragged.point, inside({ row: at.row + dragged.row, col: at.col + dragged.col }));
  dragged.moved = true;
  showPoints();
  draw();
});
function drop() {
  if (dragged && dragged.moved) commit();
  dragged = null;
}
canvas.addEventListener("pointerup", drop);
canvas.addEventListener("pointercancel", drop);

const STEPS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
stage.addEventListener("keydown", (event) => {
  const step = STEPS[event.key], list = points(), far = event.shiftKey ? 10 : 1;
  if (step && tool === "look") {
    view.top += (step[0] * far * 8) / view.zoom;
    view.left += (step[1] * far * 8) / view.zoom;
    view.fitted = false;
    keepInSight();
  } else if (step) {
    if (!list.length) return;
    active = Math.max(active, 0);
    const one = list[active];
    Object.assign(one, inside({ row: one.row + step[0] * far, col: one.col + step[1] * far }));
    showPoints();
    readOut(one);
    draw();
    commit(250);
  } else if (event.key === "Enter") {
    addInView();
  } else if (event.key === "Delete" || event.key === "Backspace") removePoint(active);
  else if (event.key === "PageDown" || event.key === "PageUp") {
    if (list.length) active = (active + (event.key === "PageDown" ? 1 : list.length - 1)) % list.length;
    showPoints();
    draw();
  } else if (event.key === "+" || event.key === "=") zoomTo(view.zoom * 1.5);
  else if (event.key === "-") zoomTo(view.zoom / 1.5);
  else if (event.key === "0") fitView();
  else return;
  event.preventDefault();
});

function readOut(at) {
  const parts = ["row " + at.row.toFixed(1), "column " + at.col.toFixed(1)];
  const { pixel_mm: pixel, place } = page.state || {};
  if (pixel && place) {
    parts.push("x = " + ((at.col - place[1]) * pixel).toFixed(4) + " mm");
    parts.push("z = " + ((at.row - place[0]) * pixel).toFixed(4) + " mm");
  }
  const order = shown.map ? orderOnMap(at) : "";
  if (order) parts.push(order);
  get("readout").textContent = parts.join("; ");
}

/* the points as fields */
function showPoints() {
  const holder = get("points"), list = points(), had = document.activeElement;
  const kept = had && holder.contains(had) ? had.id : null;
  holder.replaceChildren();
  list.forEach((one, number) => {
    const row = document.createElement("div");
    row.className = "point" + (number === active ? " active" : "");
    const fields = [["row", "row"], ["col", "column"]];
    if (tool === "order") fields.push(["order", "order"]);
    row.append(String(number + 1) + ":");
    for (const [name, words] of fields) row.append(...pointField(one, number, name, words));
    if (tool === "order") row.append(extremumField(one, number));
    const away = document.createElement("button");
    away.type = "button";
    away.textContent = "×";
    away.setAttribute("aria-label", "Take point " + (number + 1) + " away");
    away.addEventListener("click", () => removePoint(number));
    row.append(away);
    holder.append(row);
  });
  if (tool === "line" && own.line[line]) {
    const row = document.createElement("div");
    row.className = "point";
    row.append(...pointField(own.line[line], -1, "order", "order of this line"));
    holder.append(row);
  }
  showLines();
  if (kept && get(kept)) get(kept).focus();
}
/* the lines by number, as soon as there is one */
function showLines() {
  const count = ofLines() ? Math.max(own[tool].length, line + 1) : 0, select = get("line-number");
  get("line-row").hidden = !ofLines() || !own[tool].length;
  select.replaceChildren();
  for (let number = 0; number < count; number++) {
    const one = own[tool][number], order = one && one.order !== undefined ? ", order " + one.order : "";
    select.append(new Option("Line " + (number + 1) + " of " + count + (one ? order : ", new"), number, false, number === line));
  }
}
function pointField(one, number, name, words) {
  const label = document.createElement("label"), field = document.createElement("input");
  field.type = "number";
  field.id = "point-" + number + "-" + name;
  field.step = name === "order" ? "0.5" : "any";
  field.value = one[name];
  label.htmlFor = field.id;
  label.textContent = words;
  field.addEventListener("focus", () => { if (number >= 0) { active = number; draw(); } });
  field.addEventListener("change", () => {
    const value = Number(field.value);
    if (!Number.isFinite(value)) return;
    Object.assign(one, name === "order" ? { order: value } : inside({ ...one, [name]: value }));
    draw();
    commit();
  });
  return [label, field];
}
function extremumField(one, number) {
  const field = document.createElement("select");
  field.id = "point-" + number + "-extremum";
  field.setAttribute("aria-label", "Whether point " + (number + 1) + " is the highest or lowest order around it");
  for (const [value, words] of [["", "on a slope"], ["maximum", "highest around it"], ["minimum", "lowest around it"]]) {
    field.append(new Option(words, value, false, value === (one.extremum || "")));
  }
  field.addEventListener("change", () => { one.extremum = field.value || null; commit(); });
  return field;
}
function chooseTool(name) {
  tool = name;
  line = 0;
  active = points().length ? 0 : -1;
  stage.classList.toggle("pan", tool === "look");
  get("tool-words").textContent = WORDS[tool];
  get("length-row").hidden = tool !== "scale";
  get("order-row").hidden = tool !== "order" && tool !== "line";
  get("new-line").hidden = !ofLines();
  get("show-map").hidden = tool !== "order" && !ofLines();
  if (get("preview")) get("preview").hidden = !tellsOrders();
  get("add-point").hidden = get("clear-tool").hidden = tool === "look";
  if (tool !== "look") get("step-place").open = true;
  showPoints();
  draw();
  hidePreview();
  followFrame();
}
for (const radio of document.getElementsByName("tool")) {
  radio.addEventListener("change", () => chooseTool(radio.value));
}
get("add-point").addEventListener("click", addInView);
get("new-line").addEventListener("click", () => {
  const lines = own[tool];
  if (lines.length && lines.at(-1).points.length < 2) lines.pop();
  line = lines.length;
  active = -1;
  showPoints();
  draw();
});
get("line-number").addEventListener("change", () => {
  chooseLine(Number(get("line-number").value));
  showPoints();
  draw();
});
get("clear-line").addEventListener("click", () => {
  own[tool].splice(line, 1);
  line = Math.max(0, Math.min(line, own[tool].length - 1));
  active = points().length ? 0 : -1;
  showPoints();
  draw();
  commit();
});
get("clear-tool").addEventListener("click", () => {
  own[tool] = [];
  clearTimeout(commitLater[tool]);
  delete touched[tool];
  active = -1;
  line = 0;
  showPoints();
  draw();
  if (tool === "contact") useTool({ tool: "values", values: { "camera.left_mm": null, "camera.top_mm": null } });
  else if (tool === "surface") useTool({ tool: "values", values: { "camera.roll_deg": null } });
  else commit();
});
get("apply-scale").addEventListener("click", () => {
  const length = Number(get("length").value.replace(",", "."));
  if (own.scale.length < 2) say("Set two points on the picture first.", true);
  else if (!(length > 0)) say("Give the distance of the two points in mm.", true);
  else useTool({ tool: "scale", points: pairs(own.scale), length_mm: length });
});

/* marks over the picture, in pixels of the screen */
function drawMarks(to) {
  outline(to, own.region.length === 2 ? boxCorners(own.region) : [], true, "#7fd1ff", tool === "region");
  outline(to, own.mask, own.mask.length > 2, "#8cff9e", tool === "mask");
  const surface = touched.surface ? own.surface : (page.state && page.state.surface || []).map(([row, col]) => ({ row, col }));
  outline(to, surface, false, "#ffd34d", tool === "surface");
  outline(to, own.scale, false, "#ff9d2e", tool === "scale");
  own.line.forEach((one, number) => outline(to, one.points, false, "#ff8ad8", tool === "line" && number === line));
  own.boundary.forEach((one, number) => outline(to, one.points, false, "#c9a6ff", tool === "boundary" && number === line));
  for (const name of ["edges", "rollers", "rim"]) outline(to, own[name], false, "#ff9d2e", tool === name);
  drawOutlines(to);
  own.order.forEach((one) => label(to, one, String(one.order)));
  own.line.forEach((one) => { if (one.points.length) label(to, one.points[0], String(one.order)); });
  if (tool !== "contact" && own.contact.length) cross(to, own.contact[0], "#ff9d2e", false);
  if (tool !== "order") own.order.forEach((one) => cross(to, one, "#ff8ad8", false));
  points().forEach((one, number) => cross(to, one, "#ff9d2e", number === active));
}
function boxCorners([a, b]) {
  const rows = [Math.min(a.row, b.row) - 0.5, Math.max(a.row, b.row) + 0.5];
  const cols = [Math.min(a.col, b.col) - 0.5, Math.max(a.col, b.col) + 0.5];
  return [
    { row: rows[0], col: cols[0] }, { row: rows[0], col: cols[1] },
    { row: rows[1], col: cols[1] }, { row: rows[1], col: cols[0] },
  ];
}
function outline(to, list, closed, colour, strong) {
  if (list.length < 2) return;
  to.beginPath();
  list.forEach((one, number) => {
    const { x, y } = toScreen(one);
    if (number) to.lineTo(x, y); else to.moveTo(x, y);
  });
  if (closed) to.closePath();
  for (const [wide, own_colour] of [[strong ? 4 : 3, "#000"], [strong ? 2 : 1, colour]]) {
    to.lineWidth = wide;
    to.strokeStyle = own_colour;
    to.stroke();
  }
}
function cross(to, one, colour, strong) {
  const { x, y } = toScreen(one), size = strong ? 11 : 8;
  for (const [wide, own_colour] of [[strong ? 5 : 4, "#000"], [strong ? 3 : 1.5, colour]]) {
    to.lineWidth = wide;
    to.strokeStyle = own_colour;
    to.beginPath();
    to.moveTo(x - size, y);
    to.lineTo(x - 2, y);
    to.moveTo(x + 2, y);
    to.lineTo(x + size, y);
    to.moveTo(x, y - size);
    to.lineTo(x, y - 2);
    to.moveTo(x, y + 2);
    to.lineTo(x, y + size);
    to.stroke();
  }
}
function label(to, one, text) {
  const { x, y } = toScreen(one);
  to.font = "bold 14px system-ui, sans-serif";
  to.lineWidth = 4;
  to.strokeStyle = "#000";
  to.fillStyle = "#fff";
  to.strokeText(text, x + 9, y - 9);
  to.fillText(text, x + 9, y - 9);
}
