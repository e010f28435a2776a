/* The page of polaropt app: photographs are sent one after another, looked at, separated. */
"use strict";

const POLL_MS = 250;
/* Inspected: how the photographs were read that were looked at. */
let capture = null, files = [], busy = false, inspected = null;

function tell(sentence) { byId("status").textContent = sentence; }
function complain(sentence) {
  byId("problem").textContent = sentence;
  byId("problem").hidden = !sentence;
  byId("others").hidden = true;
}

async function ask(path, method = "GET", body = undefined) {
  let answer;
  try {
    answer = await fetch(path, { method, body });
  } catch {
    throw new Error("polaropt does not answer; is it still running in its window?");
  }
  const told = await answer.json().catch(() => ({}));
  if (!answer.ok) {
    const error = new Error((told && told.problem) || "polaropt cannot do that.");
    throw Object.assign(error, { busy: Boolean(told && told.busy) });
  }
  return told;
}
const of = (path) => `captures/${capture}/${path}`;

function setBusy(now) {
  busy = now;
  for (const name of ["separate", "inspect", "clear", "files"]) byId(name).disabled = now;
  byId("working").hidden = !now;
}

async function guarded(work) {
  complain("");
  setBusy(true);
  byId("bar").value = 0;
  try {
    await work();
  } catch (error) {
    tell("");
    complain(error.message);
    // Another page began it, or this one before it was loaded again.
    byId("others").hidden = !error.busy;
  } finally {
    setBusy(false);
  }
}

/* Sends the files; none of an earlier capture stays. */
async function take(chosen) {
  const megabytes = chosen.reduce((sum, file) => sum + file.size, 0) / 1e6, most = byId("drop").dataset.limitMb;
  if (megabytes > most) {
    const size = megabytes.toPrecision(3);
    throw new Error(`These are ${size} MB, and at most ${most} are taken; polaropt app --limit-mb takes more.`);
  }
  forget();
  byId("cancel").hidden = true;
  const laid = await ask("captures", "POST", JSON.stringify({ names: chosen.map((file) => file.name) }));
  capture = laid.capture;
  const left = [...chosen];
  files = laid.files.map((told) => ({ ...told, file: left.splice(left.findIndex((f) => f.name === told.name), 1)[0] }));
  for (const [i, told] of files.entries()) {
    tell(`Taking ${told.name}, ${i + 1} of ${files.length}`);
    await ask(of(`files/${encodeURIComponent(told.name)}`), "PUT", told.file);
    byId("bar").value = (i + 1) / files.length;
  }
  list();
  for (const name of ["options", "actions"]) byId(name).hidden = false;
  if (angles()?.includes(null)) tell("Give the polarizer's angle of each photograph, then look again or separate.");
  else await run("inspect");
}

function list() {
  const items = files.map((told, i) => {
    const item = document.createElement("li"), size = document.createElement("span");
    size.className = "soft";
    size.textContent = ` ${(told.file.size / 1e6).toPrecision(2)} MB`;
    if (files.length === 1) {
      item.append(told.name, size);
      return item;
    }
    const label = document.createElement("label"), angle = document.createElement("input");
    label.append(`${told.name}, angle in degrees: `, angle);
    Object.assign(angle, { type: "number", step: "any", required: true, value: told.angle ?? "", id: `angle-${i}` });
    item.append(label, size);
    return item;
  });
  byId("list").replaceChildren(...items);
  byId("list").hidden = false;
}

function angles() {
  if (files.length === 1) return null;
  return files.map((_, i) => byId(`angle-${i}`).value).map((text) => (text === "" ? null : Number(text)));
}

function options() {
  const checked = (name) => byId(name).checked, value = (name) => byId(name).value;
  return {
    angles_deg: angles(), gamma: value("gamma"), surface: value("surface"), resolution: value("resolution"),
    shape: value("shape"), pixel_format: value("pixel-format"), align: checked("align"),
    uncertainty: checked("uncertainty"),
  };
}

/* What of the options says how photographs are read. */
function reading() {
  const { surface, uncertainty, ...read } = options();
  return JSON.stringify(read);
}

/* Has polaropt do something, tells how far it is, and shows what comes of it. */
async function run(kind) {
  const [place, told] = kind === "inspect" ? ["inspection", "inspection-told"] : ["result", "result-told"];
  byId(place).hidden = true;
  byId("cancel").hidden = false;
  byId("cancel").disabled = false;
  const read = reading();
  if (kind === "inspect") inspected = null;
  await ask(of("job"), "POST", JSON.stringify({ do: kind, options: options() }));
  let job;
  for (;;) {
    job = await ask(of("job"));
    if (byId("status").textContent !== job.stage) tell(job.stage);
    byId("bar").value = job.fraction;
    if (!job.running) break;
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
  }
  if (job.problem) throw new Error(job.problem);
  byId(told).innerHTML = job.outcome;
  for (const link of byId(told).querySelectorAll("[data-href]")) link.href = of(link.dataset.href);
  // Results of the same names come again; the number makes a browser ask for them.
  for (const image of byId(told).querySelectorAll("[data-src]")) image.src = `${of(image.dataset.src)}?${Date.now()}`;
  byId(place).hidden = false;
  if (kind === "separate") {
    startCompare();
    tell(byId(told).querySelector(".alarm-box") ? "Separated, with warnings." : "Separated.");
    byId("result").focus();
  } else {
    inspected = read;
    tell(byId(told).querySelector(".alarm-box") ? "Looked at: something needs attention." : "Looked at.");
  }
}

function forget() {
  capture = inspected = null;
  files = [];
  for (const name of ["list", "options", "actions", "inspection", "result"]) byId(name).hidden = true;
  for (const name of ["list", "inspection-told", "result-told"]) byId(name).replaceChildren();
}

function chosen(list) {
  if (list.length && !busy) guarded(() => take([...list]));
}

byId("files").addEventListener("change", () => chosen(byId("files").files));
/* What they are is said of photographs as they were read; once they are to be read otherwise it is out of date. */
for (const name of ["list", "options"]) {
  byId(name).addEventListener("change", () => {
    if (inspected === null || busy) return;
    byId("inspection").hidden = inspected !== reading();
    tell(byId("inspection").hidden ? "They will be read otherwise: look again, or separate." : "Looked at.");
  });
}
byId("separate").addEventListener("click", () => guarded(() => run("separate")));
byId("inspect").addEventListener("click", () => guarded(() => run("inspect")));
byId("cancel").addEventListener("click", () => {
  byId("cancel").disabled = true;
  tell("Cancelling");
  ask(of("job"), "DELETE").catch(() => {});
});
byId("cancel-others").addEventListener("click", () => guarded(async () => {
  byId("cancel").hidden = true;
  tell("Cancelling that work");
  await ask("job", "DELETE");
  while ((await ask("job")).running) await new Promise((resolve) => setTimeout(resolve, POLL_MS));
  tell("Ended. Drop the photographs again, or choose them.");
  byId("files").value = "";
}));
byId("clear").addEventListener("click", () => guarded(async () => {
  await ask(`captures/${capture}`, "DELETE");
  forget();
  byId("files").value = "";
  tell("Removed.");
  byId("files").focus();
}));

/* Files that miss the frame are taken, too, instead of opened by the browser. */
for (const kind of ["dragenter", "dragover"]) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    byId("drop").classList.add("over");
  });
}
for (const kind of ["dragleave", "drop"]) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    byId("drop").classList.remove("over");
  });
}
document.addEventListener("drop", (event) => {
  if (busy || !event.dataTransfer.files.length) return;
  const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry?.());
  const folder = entries.find((entry) => entry?.isDirectory);
  if (folder) {
    complain(`${folder.name} is a folder; drop the photographs that are in it.`);
    return;
  }
  byId("files").files = event.dataTransfer.files;
  chosen(event.dataTransfer.files);
});
