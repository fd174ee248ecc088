/* Calibration sets: the images' loads, the specimen's outline over the picture, and Calibrate. */
shown.outlines = [];

function showLoads(state) {
  const holder = get("loads");
  if (!holder) return;
  get("calibrate").disabled = !state.has_scene;
  const typed = state.has_scene ? [] : [...holder.querySelectorAll("input")].map((one) => one.value);
  const had = document.activeElement, kept = had && holder.contains(had) ? had.id : null;
  holder.replaceChildren();
  state.images.forEach((one, number) => {
    const row = document.createElement("div"), label = document.createElement("label");
    const field = document.createElement("input");
    row.className = "field";
    field.type = "text";
    field.inputMode = "decimal";
    field.id = "load-" + number;
    field.value = typed[number] ?? (one.load_n === null ? "" : String(one.load_n));
    label.htmlFor = field.id;
    label.textContent = one.file;
    field.addEventListener("focus", () => { if (page.frame !== number) goToFrame(number); });
    field.addEventListener("change", () => {
      if (!page.state.has_scene) return;
      try { useTool({ tool: "loads", loads: readLoads() }); } catch (error) { refusedValue(error); }
    });
    row.append(label, field);
    holder.append(row);
  });
  if (kept && get(kept)) get(kept).focus();
}
function readLoads() {
  return page.state.images.map((one, number) => {
    const text = get("load-" + number).value.trim(), load = Number(text.replace(",", "."));
    if (text === "") return null;
    if (!Number.isFinite(load) || load < 0) throw new Refusal(one.file + ": '" + text + "' is no load in N.");
    return load;
  });
}

let outlinesAsked = 0;
async function askOutlines() {
  if (!page.state || !page.state.subject) return;
  const mine = ++outlinesAsked;
  shown.outlines = [];
  if (!page.state.has_scene) { draw(); return; }
  try {
    const found = await post("outlines", { frame: page.frame });
    if (mine === outlinesAsked) shown.outlines = found.outlines;
  } catch (error) { if (!(error instanceof Refusal)) lost(error); }
  draw();
  canvas.dataset.outlines = shown.outlines.length;
}
function drawOutlines(to) {
  for (const line of shown.outlines) {
    outline(to, line.map(([row, col]) => ({ row, col })), false, "#8cff9e", true);
  }
}

if (get("calibrate")) get("calibrate").addEventListener("click", () => {
  get("calibrate").disabled = true;
  // in the queue: after what the user has set before
  queue = queue.then(async () => {
    say("Calibrating …");
    try {
      showCalibration(await post("calibrate", {}));
      await askOutlines();
      say("The set is calibrated.");
      get("step-fit").open = true;
      get("step-fit").scrollIntoView({ block: "nearest" });
      return true;
    } catch (error) { refused(error); return false; } finally { get("calibrate").disabled = false; }
  });
});
/* what the images asked for besides the set, and a button where a key of the set states it */
function causesTable(causes) {
  const table = tableUnder(["The images ask for", "Found ± (standard)", "Into the set"]), body = table.createTBody();
  for (const one of causes) {
    const row = body.insertRow(), button = document.createElement("button");
    row.insertCell().textContent = one.words;
    valueCell(row, one.text);
    const last = row.insertCell();
    if (one.note) {
      const note = body.insertRow().insertCell();
      row.className = "noted";
      note.colSpan = 3;
      note.className = "hint";
      note.textContent = one.note;
    }
    if (one.key === null) { last.textContent = "no key"; continue; }
    button.type = "button";
    button.textContent = "Take";
    button.title = one.line;
    button.setAttribute("aria-label", "Take " + one.words + " into the set");
    button.addEventListener("click", () => {
      useTool({ tool: "values", values: { [one.key]: one.value } }, one.words + ": taken into the set. Calibrate again: f_sigma is found with it then.");
    });
    last.append(button);
  }
  return table;
}
function showCalibration({ values, images, causes, warnings, revision }) {
  const holder = get("fit-result"), table = tableUnder(["Value", "Found ± standard uncertainty"]);
  const body = table.createTBody();
  for (const one of values) {
    const row = body.insertRow();
    row.insertCell().textContent = one.words;
    valueCell(row, one.text);
  }
  const each = tableUnder(["Image", "Load (N)", "Order", "chi"]), rows = each.createTBody();
  for (const one of images) {
    const row = rows.insertRow();
    row.insertCell().textContent = one.file;
    for (const text of [String(one.load_n), one.order.toFixed(4), one.chi.toFixed(2)]) valueCell(row, text);
  }
  holder.dataset.revision = revision;
  holder.replaceChildren(table, ...(causes.length ? [causesTable(causes)] : []), each, listOf(warnings.map((text) => ["warning", text])));
}
