/* What a click would do to the map of orders, said before it: beside the pointer, in the line below
   the picture, and in the map's own colours. Nothing of the scene changes. */
const REST_MS = 40; // of the pointer, until it rests
const would = { timer: 0, busy: false, next: null, asked: 0, at: null, found: null };
const tellsOrders = () => tool === "order" || tool === "line";

/* all points and lines as they would stand, with one more or one changed; null where none is set */
function asIfSet(at, change) {
  const given = Number(get("new-order").value) || 0;
  const points = own.order.map((one) => ({ ...one }));
  const lines = own.line.map((one) => ({ order: one.order, points: pairs(one.points) }));
  if (tool === "order") {
    if (change) Object.assign(points[change.number], change.values);
    else if (points.length < MOST.order) points.push({ ...at, order: given, extremum: null });
    else return null;
  } else {
    if (!lines[line]) lines[line] = { order: given, points: [] };
    const mine = lines[line];
    if (change && change.number < 0) Object.assign(mine, change.values);
    else if (change) mine.points[change.number] = [at.row, at.col];
    else mine.points.push([at.row, at.col]);
    if (mine.points.length < 2) return null;
  }
  const whole = lines.filter((one) => one && one.points.length > 1);
  return { points, lines: whole, order: tool === "order" ? (change ? points[change.number] : points.at(-1)).order : lines[line].order };
}
/* asks soon; `change`: which point of the list (-1: the line itself) has which other values */
function previewSoon(at, change = null, wait = REST_MS) {
  hidePreview();
  if (!tellsOrders() || !page.state || !page.state.has_scene) return;
  would.timer = setTimeout(() => {
    const place = inside(at), asked = asIfSet(place, change);
    if (asked) askPreview({ at: [place.row, place.col], on_line: tool === "line", ...asked });
    else if (tool === "line") showPreview({ kind: "nothing", words: "a line needs two points: this would be its first.", said: [], place });
  }, wait);
}
function hidePreview() {
  clearTimeout(would.timer);
  would.asked++;
  would.next = null;
  if (!would.found) return;
  would.found = null;
  get("preview-box").hidden = true;
  get("preview").textContent = "";
  draw();
}
/* one request at a time; of those that wait the newest alone is asked */
async function askPreview(asked) {
  would.next = { ...asked, serial: ++would.asked };
  if (would.busy) return;
  would.busy = true;
  while (would.next) {
    const now = would.next;
    would.next = null;
    const slow = setTimeout(() => { if (tellsOrders()) get("preview").textContent = "Following the fringes of this frame …"; }, 400);
    try {
      const found = await post("preview", { frame: page.frame, points: [], lines: [], ...now });
      if (now.serial === would.asked && now.at) showPreview({ ...found, order: now.order, place: { row: now.at[0], col: now.at[1] } });
    } catch (error) {
      if (!(error instanceof Refusal)) { lost(error); would.next = null; }
      else if (now.serial === would.asked && now.at) showPreview({ kind: "nothing", words: error.message, said: [], place: { row: now.at[0], col: now.at[1] } });
    }
    clearTimeout(slow);
    if (get("preview").textContent.startsWith("Following")) get("preview").textContent = "";
  }
  would.busy = false;
}
/* the frame is followed before the pointer rests, so that the first answer comes at once too */
function followFrame() {
  if (tellsOrders() && page.state && page.state.has_scene) askPreview({});
}
function showPreview(found) {
  would.found = found;
  const order = found.order === undefined ? "" : (tool === "line" ? "Line of order " : "Order ") + found.order + " here: ";
  const more = found.said.map((text) => (text.startsWith("frames.") ? text : text[0].toUpperCase() + text.slice(1)) + ".");
  const { top_px: top, left_px: left } = page.state.region;
  if (more.length && (top || left)) more.push("(Rows and columns are counted in the region: add " + top + " and " + left + ".)");
  get("preview").textContent = [order + found.words, ...more].join(" ");
  get("preview").dataset.kind = found.kind;
  const box = get("preview-box");
  box.textContent = order + found.words;
  box.dataset.kind = found.kind;
  box.hidden = false;
  if (found.levels) {
    const bytes = Uint8Array.from(atob(found.levels), (one) => one.charCodeAt(0));
    found.picture = bitmap(bytes, found.rows.length, found.cols.length, ORDERS);
  }
  placePreview();
  draw();
}
/* beside the place, inside of the picture's frame */
function placePreview() {
  const box = get("preview-box"), { x, y } = toScreen(would.found.place), room = stageBox();
  const wide = box.offsetWidth, high = box.offsetHeight, gap = 18;
  const right = x + gap + wide <= room.width, below = y + gap + high <= room.height;
  box.style.left = clamp(right ? x + gap : x - gap - wide, 0, Math.max(0, room.width - wide)) + "px";
  box.style.top = clamp(below ? y + gap : y - gap - high, 0, Math.max(0, room.height - high)) + "px";
}
/* the part's patches in the colours that the map would have */
function drawPreview(to) {
  const found = would.found;
  if (!found || !found.picture) return;
  const { top_px: top, left_px: left } = page.state.region, { rows, cols } = found;
  const step = (list) => (list.at(-1) - list[0]) / Math.max(1, list.length - 1);
  const down = step(rows), right = step(cols);
  to.save();
  to.imageSmoothingEnabled = false;
  to.globalAlpha = 0.6;
  to.drawImage(found.picture, left + cols[0] + 0.5 - right / 2, top + rows[0] + 0.5 - down / 2, right * cols.length, down * rows.length);
  to.restore();
}

canvas.addEventListener("pointermove", (event) => {
  if (!shown.picture || !tellsOrders() || (dragged && dragged.pan)) return;
  const at = toPicture(event), isOut = at.row < -0.5 || at.col < -0.5 || at.row > shown.rows - 0.5 || at.col > shown.cols - 0.5;
  if (dragged) {
    const number = points().indexOf(dragged.point);
    previewSoon(dragged.point, { number, values: { ...dragged.point } });
  } else if (isOut || nearest(at, REACH_PX) >= 0) hidePreview(); // a click there takes the point in hand
  else previewSoon(at);
  would.at = at;
});
canvas.addEventListener("pointerleave", () => { if (!dragged) { would.at = null; hidePreview(); } });
canvas.addEventListener("pointerdown", hidePreview);
canvas.addEventListener("pointerup", hidePreview);
stage.addEventListener("wheel", hidePreview, { passive: true });
stage.addEventListener("blur", () => { if (!would.at) hidePreview(); });
/* what Enter would set, in the middle of the view; and where an arrow has just moved a point to */
stage.addEventListener("focus", () => { if (stage.matches(":focus-visible")) previewSoon(middleOfView()); });
stage.addEventListener("keydown", (event) => {
  if (event.key in STEPS && points()[active]) previewSoon(points()[active], { number: active, values: {} }, 0);
  else hidePreview();
});
get("new-order").addEventListener("input", () => previewSoon(would.at || middleOfView()));
/* a number that is typed into a point's field, before the field is left */
get("points").addEventListener("input", (event) => {
  const parts = /^point-(-?\d+)-(row|col|order)$/.exec(event.target.id), value = Number(event.target.value);
  if (!parts || event.target.value === "" || !Number.isFinite(value)) { hidePreview(); return; }
  const number = Number(parts[1]), mine = points(), values = { [parts[2]]: value };
  const at = number < 0 ? mine[0] : { ...mine[number], ...values };
  if (at) previewSoon(at, { number, values });
});
get("points").addEventListener("change", hidePreview);
