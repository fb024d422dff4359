// Follows jobs by server-sent events, submits scenes, cancels jobs. All markup comes from the server's templates.
"use strict";

const jobs = document.getElementById("jobs");
const { follow, after, only } = document.body.dataset;

async function fetchCard(id) {
  const answer = await fetch(`/jobs/${id}/card`);
  if (!answer.ok) return null;
  return new DOMParser().parseFromString(await answer.text(), "text/html").querySelector(".card");
}

// Refreshes of one job never overlap: events that arrive meanwhile ask for one more.
const refreshing = new Map();

async function refresh(id) {
  if (refreshing.has(id)) return void refreshing.set(id, true);
  refreshing.set(id, false);
  try {
    const fresh = await fetchCard(id);
    if (fresh) show(fresh);
  } finally {
    const again = refreshing.get(id);
    refreshing.delete(id);
    if (again) refresh(id);
  }
}

function show(fresh) {
  const shown = document.getElementById(fresh.id);
  if (!shown) {
    if (only) return;
    jobs.prepend(fresh);
    document.getElementById("empty").hidden = true;
  } else if (shown.dataset.state !== fresh.dataset.state || !sameActions(shown, fresh)) {
    shown.replaceWith(fresh);
    if (only && isFinal(fresh.dataset.state)) location.reload(); // the report is there now
  } else {
    // the buttons stay as they are, so that whoever is about to press one can
    shown.querySelector(".live").replaceWith(fresh.querySelector(".live"));
  }
}

const sameActions = (a, b) => a.querySelector("footer").innerHTML === b.querySelector("footer").innerHTML;
const isFinal = (state) => !["queued", "running"].includes(state);

async function refreshCensus() {
  const counters = document.querySelectorAll("[data-census]");
  if (!counters.length) return;
  const census = await (await fetch("/census")).json();
  for (const counter of counters) counter.textContent = census[counter.dataset.census];
}

function listen() {
  const source = new EventSource(`${follow}?after=${after}`);
  const note = (event) => {
    const id = JSON.parse(event.data).job;
    if (!only || only === id) refresh(id);
    if (event.type === "state") refreshCensus();
  };
  source.addEventListener("state", note);
  source.addEventListener("progress", note);
}

function element(name, text, className) {
  const made = document.createElement(name);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

function explain(problem) {
  const outcome = document.getElementById("outcome");
  const list = document.createElement("ul");
  for (const { path, message, allowed } of problem.problems ?? []) {
    const item = document.createElement("li");
    item.append(element("code", path || "scene"), ` ${message}`);
    if (allowed) item.append(element("span", `allowed: ${allowed}`, "allowed"));
    list.append(item);
  }
  outcome.className = "error";
  outcome.replaceChildren(element("p", problem.detail ?? "The service did not understand."), list);
}

async function submit(scene) {
  const outcome = document.getElementById("outcome");
  outcome.className = "";
  outcome.replaceChildren(element("p", "Checking the scene…"));
  try {
    const answer = await fetch("/v1/jobs", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: scene,
    });
    const body = await answer.json();
    if (!answer.ok) return explain(body);
    outcome.className = "done";
    outcome.replaceChildren(element("p", `Submitted as ${body.id}.`));
    refresh(body.id);
  } catch {
    explain({ detail: "The service cannot be reached." });
  }
}

function prepareForm(form) {
  const shipped = document.getElementById("shipped");
  const link = document.getElementById("scene-link");
  const drop = document.getElementById("drop");
  const file = document.getElementById("file");
  const point = () => { link.href = `/v1/scenes/${encodeURIComponent(shipped.value)}`; };
  shipped.addEventListener("change", point);
  point();
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    submit(await (await fetch(link.href)).text());
  });
  file.addEventListener("change", () => {
    if (file.files.length) submit(file.files[0]);
    file.value = "";
  });
  for (const kind of ["dragover", "dragleave", "drop"]) {
    drop.addEventListener(kind, (event) => {
      event.preventDefault();
      drop.classList.toggle("over", kind === "dragover");
      if (kind === "drop" && event.dataTransfer.files.length) submit(event.dataTransfer.files[0]);
    });
  }
}

document.addEventListener("click", async (event) => {
  const id = event.target.dataset?.cancel;
  if (!id) return;
  event.target.disabled = true;
  await fetch(`/v1/jobs/${id}/cancel`, { method: "POST" });
  refresh(id);
});

const form = document.getElementById("submit");
if (form) prepareForm(form);
if (follow) listen();
