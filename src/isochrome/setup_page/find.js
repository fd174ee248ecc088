/* The cold search: what the server finds in the shown frame goes into the scene, in one step. */
let searching = false;

function showFind(state) {
  const button = get("find"), can = data.searched.includes(state.has_scene ? state.model : get("kind").value);
  button.disabled = searching || !can;
  button.title = can ? "" : "Only a contact under a cylinder and a disc are searched for.";
  if (!state.has_scene) get("find-result").hidden = true; // taken back
  button.classList.toggle("main", can && state.values["camera.left_mm"] === undefined);
}
get("find").addEventListener("click", () => {
  const asked = { frame: page.frame, held: get("find-held").checked };
  try {
    if (!page.state.has_scene) Object.assign(asked, readForm());
  } catch (error) { refused(error); return; }
  searching = true;
  get("find").disabled = true;
  // in the queue: what the user does meanwhile goes into the scene that the search leaves
  queue = queue.then(async () => {
    say("Searching frame " + page.frame + ": some seconds …");
    try {
      const found = await post("find", asked);
      for (const name in touched) delete touched[name];
      get("step-scene").open = false;
      get("step-place").open = get("step-check").open = true;
      await takeAll(found.state);
      showFound(found);
      if (page.frame !== found.frame) await goToFrame(found.frame);
      say("Found in frame " + found.frame + ", and set in the scene; Undo takes it back, Save writes it.");
      return true;
    } catch (error) {
      refused(error);
      return false;
    } finally {
      searching = false;
      showFind(page.state);
    }
  });
});
function showFound({ frame, chi, found, warnings }) {
  const holder = get("find-result"), head = document.createElement("p");
  head.textContent = "Found in frame " + frame + "; the fringes leave " +
    (chi === null ? "what is not known" : chi.toFixed(2) + " times the frame's noise") +
    "; ± from the picture alone: what was given was taken as exact.";
  const table = tableUnder(["Value", "Found ± (standard)"]), body = table.createTBody();
  for (const one of found) {
    const row = body.insertRow(), what = row.insertCell();
    row.dataset.key = one.key;
    what.textContent = nameOf(one.key);
    valueCell(row, one.text);
    if (!one.note) continue;
    const below = body.insertRow(), note = below.insertCell();
    row.className = "noted";
    note.colSpan = 2;
    note.className = "hint";
    note.textContent = one.note;
  }
  holder.hidden = false;
  holder.replaceChildren(head, table, listOf(warnings.map((text) => ["warning", text])));
}
