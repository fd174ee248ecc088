/* The panel: the form, fit, check, text and save, and the talk with the server. */
const data = JSON.parse(get("data").textContent);
const page = { state: null, frame: 0, checked: -1, fit: null };
const FORM_HINT = get("form-hint").textContent;
const FAST_PIXELS = 2e7; // frames that are looked through in a second or so: this then comes by itself

function say(text, wrong = false) {
  get("status").textContent = text;
  get("status").classList.toggle("wrong", wrong);
}
function lost(error) {
  say("The page cannot reach isochrome any more (" + error.message + "): start `isochrome setup` again.", true);
}
async function post(name, body) {
  const answer = await fetch(name, {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  });
  const found = await answer.json();
  if (!answer.ok) throw new Refusal(found.error);
  return found;
}
const noun = (state) => state.subject ? "set" : "scene";
class Refusal extends Error {}
const refused = (error) => { if (error instanceof Refusal) say(error.message, true); else lost(error); };
/* a value that was refused leaves its field: the fields show the scene */
let notTaken = ""; // what the last refusal said, until something else is done
function refusedValue(error) {
  refused(error);
  notTaken = error.message;
  if (page.state) showValues(page.state);
}

function notWritten() {
  if (notTaken) return "Saved, without the value that was refused: " + notTaken;
  return isTyped() ? "Saved, without the text that is typed below and not used yet." : "";
}

/* tools go one after the other: each begins with the scene that the last has left */
let queue = Promise.resolve(true);
const NO_VALUES = ["new", "text", "undo", "save"]; // tools whose refusal concerns no single value
function useTool(asked, done = "", settled = () => null) {
  queue = queue.then(async () => {
    try {
      const state = await post("tool", asked);
      settled();
      const without = asked.tool === "save" ? notWritten() : "";
      say(without || done || (state.saved ? "Saved." : "The " + noun(state) + " has changed; Save writes it."), without !== "");
      notTaken = "";
      await takeAll(state);
      return true;
    } catch (error) {
      settled();
      const slid = Object.keys(overlay.values).length;
      refusedValue(error);
      if (NO_VALUES.includes(asked.tool)) notTaken = "";
      if (page.state) takeState(page.state);
      if (slid) askModel(); // the sliders are back, and so is the model
      return false;
    }
  });
  return queue;
}
async function takeAll(state) {
  const before = page.state;
  page.state = state;
  get("saved").textContent = state.saved ? "saved" : state.has_scene ? "not saved yet" : "";
  get("save").disabled = !state.has_scene;
  get("fit").disabled = !state.model;
  showText(state);
  if (get("contact-name")) get("contact-name").textContent = !state.model || state.model === "contact" ? "Contact point" : "Middle of the top";
  get("make-row").hidden = get("kind-row").hidden = state.has_scene;
  get("form-hint").textContent = state.has_scene
    ? "A value goes into the scene as soon as you leave its field."
    : FORM_HINT;
  showFind(state);
  const last = state.frames.count - 1;
  get("frame").max = get("frame-number").max = last;
  get("frame-count").textContent = "of 0 to " + last;
  showValues(state);
  takeState(state);
  const isOther = !before || turned(before) !== turned(state) || before.frames.count !== state.frames.count;
  if (isOther) await showFrame(Math.min(page.frame, last));
  if (!before || before.text !== state.text) renewMap(before, state);
  if (state.model && state.pixel_mm && (!before || !before.model || !before.pixel_mm)) {
    get("show-model").checked = true;
    get("step-model").open = true;
  }
  askModel();
  askOutlines();
  hidePreview();
  followFrame();
  checkSoon();
}
function showValues(state) {
  showFields(state);
  showNoLoad(state);
  showSliders(state);
  showLoads(state);
  showKind(state);
}
/* what is of a model alone is not offered for a specimen without one */
function showKind(state) {
  const isOther = kindOf(state) === "other";
  get("place-words").hidden = get("held-row").hidden = isOther || Boolean(state.subject);
  get("order-words").hidden = !isOther;
  get("slider-words").hidden = isOther;
  showOver(state);
}
const turned = (state) => JSON.stringify([
  "frames.rotate_deg", "frames.flip", "frames.channel", "camera.bit_depth", "polariscope.wavelength_nm",
  "frames.no_load_dark", "frames.no_load_bright", // of a folder, which files are frames
].map((key) => state.values[key]));

let frameAsked = 0;
async function showFrame(number) {
  const mine = ++frameAsked;
  try {
    const answer = await fetch("frame?frame=" + number);
    if (!answer.ok) { say((await answer.json()).error, true); return; }
    const rows = Number(answer.headers.get("X-Rows")), cols = Number(answer.headers.get("X-Cols"));
    const bytes = new Uint8Array(await answer.arrayBuffer());
    if (mine !== frameAsked) return;
    const resized = rows !== shown.rows || cols !== shown.cols;
    Object.assign(shown, { picture: bitmap(bytes, rows, cols, GREYS), rows, cols });
    page.frame = number;
    get("frame").value = get("frame-number").value = number;
    if (resized || view.fitted) fitView(); else draw();
    canvas.dataset.frame = number;
  } catch (error) { lost(error); }
}
async function goToFrame(number) {
  hideMap();
  await showFrame(clamp(Math.round(number) || 0, 0, page.state.frames.count - 1));
  hidePreview();
  followFrame();
  askModel();
  askOutlines();
}
get("frame").addEventListener("input", () => goToFrame(Number(get("frame").value)));
get("frame-number").addEventListener("change", () => goToFrame(Number(get("frame-number").value)));

/* fields */
const kindOf = (state) => {
  if (!state.has_scene || state.subject) return get("kind").value;
  const shape = state.values["specimen.shape"];
  return state.model || (shape in data.kinds ? shape : "other");
};
function showFields(state) {
  const form = get("fields"), kind = kindOf(state), had = document.activeElement;
  const kept = had && form.contains(had) ? had.id : null;
  const typed = new Map(state.has_scene ? [] : [...form.elements].map((one) => [one.dataset.key, one.value]));
  form.replaceChildren();
  let group = "", holder = form;
  for (const field of data.fields) {
    if (!field.kinds.includes(kind)) continue;
    if (field.group !== group) {
      group = field.group;
      holder = startGroup(form, group);
    }
    const stated = state.values[field.key];
    let value = state.has_scene ? shownValue(stated) : typed.get(field.key) ?? field.usual;
    if (!state.has_scene && !value && field.key === "camera.pixel_mm" && state.frames.pixel_mm) {
      value = String(Number(state.frames.pixel_mm.toPrecision(8)));
    }
    if (!state.has_scene && !value && field.key === "camera.bit_depth" && state.frames.bit_depth) {
      value = String(state.frames.bit_depth);
    }
    holder.append(fieldRow(field, value, state));
  }
  if (kept && get(kept)) get(kept).focus();
}
let seldomOpen = false;
function startGroup(form, group) {
  const folded = group === "Seldom needed";
  const head = document.createElement(folded ? "summary" : "p");
  head.className = "group";
  head.textContent = group;
  if (!folded) { form.append(head); return form; }
  const holder = document.createElement("details");
  holder.className = "plain";
  holder.open = seldomOpen;
  holder.addEventListener("toggle", () => { seldomOpen = holder.open; });
  holder.append(head);
  form.append(holder);
  return holder;
}
function shownValue(value) {
  if (value === undefined || value === null) return "";
  if (Array.isArray(value)) return value.join(" ");
  return typeof value === "object" ? "a table" : String(value);
}
function fieldRow(field, value, state) {
  const row = document.createElement("div"), label = document.createElement("label");
  const input = document.createElement(field.choices.length ? "select" : "input");
  row.className = "field";
  input.id = "field-" + field.key;
  input.dataset.key = field.key;
  label.htmlFor = input.id;
  label.textContent = field.label + (field.unit ? " (" + field.unit + ")" : "") + (field.needed && !state.has_scene ? "\u00a0*" : "");
  if (field.choices.length) {
    for (const choice of field.choices) {
      const words = { "": "–", true: "yes", false: "no" }[choice] ?? choice;
      input.append(new Option(words, choice, false, choice === value));
    }
  } else {
    input.type = "text";
    input.value = value;
    if (value === "a table") input.readOnly = true;
  }
  input.required = field.needed;
  row.append(label, input);
  if (field.hint) {
    const hint = document.createElement("p");
    hint.className = "hint";
    hint.id = input.id + "-hint";
    hint.textContent = field.hint;
    input.setAttribute("aria-describedby", hint.id);
    row.append(hint);
  }
  input.addEventListener("change", () => {
    if (!page.state.has_scene || input.readOnly) return;
    try {
      useTool({ tool: "values", values: { [field.key]: readField(field, input.value) } });
    } catch (error) { refusedValue(error); }
  });
  return row;
}
/* a field's text as a value; a decimal comma is a point */
const LISTS = ["wear.distances_m", "frames.known_loads_n"];
function readField(field, text) {
  const plain = text.trim();
  if (plain === "") return null;
  if (field.choices.length) {
    if (plain === "true" || plain === "false") return plain === "true";
    return /^\d+$/.test(plain) ? Number(plain) : plain;
  }
  const number = (word) => {
    const value = Number(word.replace(",", "."));
    if (!Number.isFinite(value)) throw new Refusal(field.label + ": '" + word + "' is no number.");
    return value;
  };
  if (LISTS.includes(field.key)) return plain.split(/[\s;]+/).map(number);
  if (field.key === "frames.gamma" && plain === "unknown") return plain;
  return number(plain);
}
get("kind").addEventListener("change", () => {
  showFields(page.state);
  showFind(page.state);
  showSliders(page.state);
  showKind(page.state);
});
function readForm() {
  const kind = get("kind").value, values = {};
  for (const field of data.fields) {
    const input = get("field-" + field.key);
    if (field.kinds.includes(kind) && input) values[field.key] = readField(field, input.value);
  }
  return page.state.subject ? { kind, values, loads: readLoads() } : { kind, values };
}
get("make").addEventListener("click", () => {
  let form;
  try { form = readForm(); } catch (error) { refused(error); return; }
  const next = page.state.subject ? "The set is made. Next: Calibrate, above the picture." : "The scene is made. Next: where it is in the picture.";
  useTool({ tool: "new", ...form }, next).then((made) => {
    if (!made) return;
    get("step-scene").open = false;
    get("step-place").open = get("step-check").open = true;
    if (page.state.model) {
      const radio = document.querySelector("input[name=tool][value=" + (page.state.pixel_mm ? "contact" : "scale") + "]");
      radio.checked = true;
      chooseTool(radio.value);
    }
    get("step-place").scrollIntoView({ block: "start" });
  });
});

function showNoLoad(state) {
  for (const light of ["dark", "bright"]) {
    const select = get("no-load-" + light), stated = state.values["frames.no_load_" + light] || "";
    const names = state.beside.filter((name) => !name.endsWith(".csv"));
    if (stated && !names.includes(stated)) names.push(stated);
    select.replaceChildren(new Option("none", ""), ...names.map((name) => new Option(name, name, false, name === stated)));
    select.disabled = !state.has_scene;
  }
}
for (const light of ["dark", "bright"]) {
  get("no-load-" + light).addEventListener("change", (event) => {
    useTool({ tool: "values", values: { ["frames.no_load_" + light]: event.target.value || null } });
  });
}

/* fit */
get("fit").addEventListener("click", async () => {
  get("fit").disabled = true;
  say("Fitting frame " + page.frame + " …");
  try {
    page.fit = await post("fit", { frame: page.frame });
    showFit();
    say("Frame " + page.frame + " is fitted.");
    get("step-fit").open = true;
    get("step-fit").scrollIntoView({ block: "nearest" });
  } catch (error) { refused(error); } finally { get("fit").disabled = !page.state.model; }
});
function showFit() {
  const { values, warnings, chi, wrong, kept_share: kept, frame, summary_text: summary } = page.fit, holder = get("fit-result");
  holder.replaceChildren();
  get("take-all").hidden = wrong || !values.length;
  const head = document.createElement("p");
  head.textContent = "Frame " + frame + ": chi = " + (chi === null ? "not known" : chi.toFixed(2)) +
    " (1 = within the noise)" + (kept ? "; order read in " + Math.round(100 * kept) + " % of the specimen." : ".");
  const sentence = document.createElement("p");
  sentence.textContent = summary + ".";
  holder.append(head, ...(values.length ? [sentence] : []));
  if (wrong && values.length) {
    const why = document.createElement("p");
    why.textContent = "chi is over 3: the model leaves far more than the noise, so its values are not offered together. See the warnings, and set right what is wrong first.";
    holder.append(why);
  }
  if (values.length) {
    const table = tableUnder(["Value", "Found ± standard uncertainty", "Into the scene"]);
    const body = table.createTBody();
    for (const one of values) {
      const row = body.insertRow(), button = document.createElement("button");
      const what = row.insertCell();
      what.textContent = nameOf(one.key);
      if (one.asked) what.append(": the frame asks for it");
      if (one.refined) what.append(": refined, and in agreement with what is stated");
      valueCell(row, one.text);
      button.type = "button";
      button.textContent = "Take";
      button.setAttribute("aria-label", "Take " + one.key + " into the scene");
      button.title = one.line;
      button.addEventListener("click", () => takeValues([one]));
      row.insertCell().append(button);
    }
    holder.append(table);
  }
  holder.append(listOf(warnings.map((text) => ["warning", text])));
}
function tableUnder(heads) {
  const table = document.createElement("table"), top = table.createTHead().insertRow();
  for (const words of heads) {
    const cell = document.createElement("th");
    cell.scope = "col";
    cell.textContent = words;
    top.append(cell);
  }
  return table;
}
/* a number that does not break, however narrow the page is */
function valueCell(row, text) {
  const cell = row.insertCell();
  cell.className = "value";
  cell.textContent = text;
}
function nameOf(key) {
  const kind = page.state ? kindOf(page.state) : "";
  const named = data.fields.find((field) => field.key === key && field.kinds.includes(kind));
  return named ? named.label + (named.unit ? " (" + named.unit + ")" : "") : key;
}
function takeValues(list) {
  const values = {};
  for (const one of list) {
    const stated = page.state.values[one.key];
    if (stated === undefined || typeof stated !== "object") values[one.key] = one.value;
  }
  useTool({ tool: "values", values }, "Taken into the scene: " + Object.keys(values).join(", ") + ".");
}
get("take-all").addEventListener("click", () => takeValues(page.fit.values));
function listOf(rows) {
  const list = document.createElement("ul");
  for (const [level, text] of rows) {
    const item = document.createElement("li");
    item.className = "finding-" + level;
    item.textContent = level + ": " + text;
    list.append(item);
  }
  return list;
}

/* check: by itself where it is quick, without the fit of a frame, which the button asks for */
let checkTimer = 0, checking = false;
function checkSoon() {
  clearTimeout(checkTimer);
  const { count, rows, cols } = page.state.frames;
  if (!page.state.has_scene || page.checked === page.state.revision) return;
  get("check-result").textContent = "The " + noun(page.state) + " has changed since the last check.";
  if (count * rows * cols <= FAST_PIXELS) checkTimer = setTimeout(() => checkNow(false), 1500);
}
async function checkNow(fringes) {
  clearTimeout(checkTimer);
  if (checking) { // one that comes by itself gives way to the next, one that was asked for does not
    const later = setTimeout(() => checkNow(fringes), 500);
    if (!fringes) checkTimer = later;
    return;
  }
  checking = true;
  get("check-result").textContent = "Checking …";
  try {
    const found = await post("check", { fringes });
    page.checked = found.revision;
    get("check-result").replaceChildren();
    const head = document.createElement("p");
    head.textContent = found.frames + (found.frames === 1 ? " frame" : " frames") + " read: " + (found.ok ? "no error found." : "errors found, see below.") +
      (found.whole ? "" : " “Check now” fits a frame as well.");
    get("check-result").append(head, listOf(found.findings.map((one) => [one.level, one.text])));
    get("check-result").dataset.ok = found.ok;
    get("check-result").dataset.whole = found.whole;
    get("check-result").dataset.revision = found.revision;
    if (page.state.revision !== found.revision) checkSoon();
  } catch (error) {
    get("check-result").textContent = error.message;
  } finally { checking = false; }
}
get("check").addEventListener("click", () => checkNow(true));

/* the text: what is typed and not used yet stays, whatever is done beside it */
let shownText = "";
const plainLines = (text) => text.replace(/\r\n?/g, "\n"); // as a field of text has them
const isTyped = () => get("text").value !== shownText;
function showText(state) {
  const text = plainLines(state.text);
  if (!isTyped()) get("text").value = text;
  shownText = text;
  markText();
}
const markText = () => { get("text-typed").hidden = !isTyped(); };
get("text").addEventListener("input", markText);
get("drop-text").addEventListener("click", () => {
  get("text").value = shownText;
  markText();
  get("text").focus();
});
get("use-text").addEventListener("click", () => useTool({ tool: "text", text: get("text").value }));
get("undo").addEventListener("click", () => useTool({ tool: "undo" }, "Taken back.", () => { for (const name in touched) delete touched[name]; }));
get("save").addEventListener("click", () => useTool({ tool: "save" }, "Saved."));
addEventListener("beforeunload", (event) => {
  if (page.state && ((page.state.has_scene && !page.state.saved) || isTyped())) event.preventDefault();
});
addEventListener("keydown", (event) => {
  if ((event.ctrlKey || event.metaKey) && event.key === "s") { event.preventDefault(); get("save").click(); }
});
for (const form of document.forms) form.addEventListener("submit", (event) => event.preventDefault());

new EventSource("life"); // as long as this is open, the server stays
chooseTool("look");
(async () => {
  try {
    const answer = await fetch("state");
    if (!answer.ok) throw new Refusal((await answer.json()).error);
    const state = await answer.json();
    await takeAll(state);
    const first = state.subject ? "press Make the set." : "press Find it in the frames, or Make the scene.";
    say(state.has_scene ? "The " + noun(state) + " is on the picture." : "No " + noun(state) + " yet: fill in step 1, then " + first);
  } catch (error) { refused(error); }
})();
