"use strict";
/* The picture: what is drawn, where it is on the screen, and which pixel is under the mouse.
   Rows and columns are those of the whole frame, pixel centres at whole numbers. */
const get = (id) => document.getElementById(id);
const stage = get("stage"), canvas = get("canvas"), pen = canvas.getContext("2d");
const LEAST_ZOOM = 0.05, MOST_ZOOM = 32, REACH_PX = 11;
/* left, top: the picture's place, in picture pixels from its outer edge, at the stage's corner */
const view = { zoom: 1, left: 0, top: 0, fitted: true };
const shown = { picture: null, rows: 0, cols: 0, model: null, map: null };

function stageBox() { return stage.getBoundingClientRect(); }
function toPicture(event) {
  const box = canvas.getBoundingClientRect();
  return {
    row: view.top + (event.clientY - box.top) / view.zoom - 0.5,
    col: view.left + (event.clientX - box.left) / view.zoom - 0.5,
  };
}
function toScreen(point) {
  return {
    x: (point.col + 0.5 - view.left) * view.zoom,
    y: (point.row + 0.5 - view.top) * view.zoom,
  };
}
function middleOfView() {
  const box = stageBox();
  return {
    row: clamp(Math.round(view.top + box.height / 2 / view.zoom - 0.5), 0, shown.rows - 1),
    col: clamp(Math.round(view.left + box.width / 2 / view.zoom - 0.5), 0, shown.cols - 1),
  };
}
function clamp(value, low, high) { return Math.min(Math.max(value, low), high); }

function zoomTo(zoom, atX, atY) {
  const box = stageBox();
  const x = atX ?? box.width / 2, y = atY ?? box.height / 2;
  const next = clamp(zoom, LEAST_ZOOM, MOST_ZOOM);
  view.left += x / view.zoom - x / next;
  view.top += y / view.zoom - y / next;
  view.zoom = next;
  view.fitted = false;
  keepInSight();
}
function keepInSight() {
  const box = stageBox(), wide = box.width / view.zoom, high = box.height / view.zoom;
  view.left = clamp(view.left, Math.min(0, shown.cols - wide) - wide / 2, Math.max(0, shown.cols - wide) + wide / 2);
  view.top = clamp(view.top, Math.min(0, shown.rows - high) - high / 2, Math.max(0, shown.rows - high) + high / 2);
  get("zoom").value = Number(view.zoom.toFixed(3));
  draw();
}
function fitView() {
  const box = stageBox();
  if (!shown.cols || !box.width) return;
  view.zoom = clamp(Math.min(box.width / shown.cols, box.height / shown.rows), LEAST_ZOOM, MOST_ZOOM);
  view.left = (shown.cols - box.width / view.zoom) / 2;
  view.top = (shown.rows - box.height / view.zoom) / 2;
  view.fitted = true;
  get("zoom").value = Number(view.zoom.toFixed(3));
  draw();
}

/* grey levels, or colours by level, as a picture that can be drawn */
function bitmap(bytes, rows, cols, colours) {
  const own = document.createElement("canvas");
  own.width = cols;
  own.height = rows;
  const data = new ImageData(cols, rows), words = new Uint32Array(data.data.buffer);
  for (let at = 0; at < words.length; at++) words[at] = colours[bytes[at]];
  own.getContext("2d").putImageData(data, 0, 0);
  return own;
}
const GREYS = new Uint32Array(256).map((_, level) => 0xff000000 | (level << 16) | (level << 8) | level);
/* orders in steps of 0.02 fringe: one turn of colours a fringe, darker towards its whole number */
const ORDERS = new Uint32Array(256).map((_, level) => {
  if (!level) return 0;
  const order = (level - 1) * 0.02, turn = order - Math.floor(order), hue = (Math.floor(order) * 67) % 360;
  const own = document.createElement("canvas").getContext("2d");
  own.fillStyle = "hsl(" + hue + " 80% " + (30 + 45 * turn) + "%)";
  const [, r, g, b] = /#(..)(..)(..)/.exec(own.fillStyle).map((part) => parseInt(part, 16));
  return (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
});

const MOST_SHIFT_PX = 8; // some multiple of an eighth of a pixel is whole by then
const isWhole = (value) => Math.abs(value - Math.round(value)) < 1e-6;
function wholeFrom(value, scale) {
  const first = Math.ceil(value - 1e-6);
  for (let at = first; at < first + MOST_SHIFT_PX; at++) if (isWhole(at * scale)) return at;
  return first;
}
function wholeBelow(value, scale) {
  const last = Math.max(1, Math.floor(value + 1e-6));
  for (let at = last; at > Math.max(1, last - MOST_SHIFT_PX); at--) if (isWhole(at * scale)) return at;
  return last;
}
let drawAsked = false;
function draw() {
  if (drawAsked) return;
  drawAsked = true;
  requestAnimationFrame(() => { drawAsked = false; drawNow(); });
}
function drawNow() {
  const box = stageBox(), scale = window.devicePixelRatio || 1;
  /* a browser paints a canvas on whole pixels, of the page or of the screen, wherever its box is:
     it is put where both are whole, so that what is drawn lies where the mouse is told to be */
  const x = wholeFrom(box.left, scale), y = wholeFrom(box.top, scale);
  const wide = wholeBelow(box.right - x, scale), high = wholeBelow(box.bottom - y, scale);
  Object.assign(canvas.style, { left: x - box.left + "px", top: y - box.top + "px", width: wide + "px", height: high + "px" });
  if (canvas.width !== Math.round(wide * scale) || canvas.height !== Math.round(high * scale)) {
    canvas.width = Math.round(wide * scale);
    canvas.height = Math.round(high * scale);
  }
  const unit = scale * view.zoom;
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  if (!shown.picture) return;
  pen.setTransform(unit, 0, 0, unit, -view.left * unit, -view.top * unit);
  pen.imageSmoothingEnabled = unit < 3; // else pixels are squares; nearer, they would be shifted by a half
  pen.drawImage(shown.picture, 0, 0);
  drawOver(pen);
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  drawMarks(pen);
  if (shown.model) canvas.dataset.model = shown.model.serial;
}
addEventListener("scroll", draw, { passive: true, capture: true });
new ResizeObserver(() => { if (view.fitted) fitView(); else keepInSight(); }).observe(stage);

stage.addEventListener("wheel", (event) => {
  event.preventDefault();
  const box = stageBox();
  zoomTo(view.zoom * Math.exp(-event.deltaY / 500), event.clientX - box.left, event.clientY - box.top);
}, { passive: false });
get("zoom-in").addEventListener("click", () => zoomTo(view.zoom * 1.5));
get("zoom-out").addEventListener("click", () => zoomTo(view.zoom / 1.5));
get("zoom-fit").addEventListener("click", fitView);
get("zoom").addEventListener("change", () => zoomTo(Number(get("zoom").value) || 1));
