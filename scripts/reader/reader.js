// A page that finds the faces in a photograph of its user and shows their landmarks and maps. scripts/build_reader.sh
// builds it into pix2face/assets/reader/reader.js; pix2face/photographs/reader_page.py packs the page.
//
// What the networks need to be told lies as JSON in #settings. After each photograph, a "read" event of the document
// says what was found: {problem} or {faces}, whose positions are in pixels of the photograph.

import { findFaces } from "./detector.js";
import { drawFaces, LEGENDS } from "./drawing.js";
import { readFaces } from "./faces.js";
import { openNetworks, unpacked } from "./networks.js";
import { openPhotograph, pixelsOf, Problem, turned } from "./picture.js";

const byId = (id) => document.getElementById(id);
const settings = JSON.parse(byId("settings").textContent);
let networks; // a promise
let photograph = null;
let faces = [];
let latest = Promise.resolve();

// Says what is being done, and waits until the browser has shown it.
async function report(text, state = "running") {
  document.body.dataset.state = state;
  byId("status").textContent = text;
  await new Promise((resume) => setTimeout(resume, 20));
}

// Photographs are read one after the other.
function enqueue(open) {
  latest = latest.then(() => read(open));
}

async function read(open) {
  try {
    await report("Opening the photograph…");
    photograph = await open();
    faces = [];
    show();
    const { find, ...halves } = await networks;
    const start = performance.now();
    const picture = pixelsOf(photograph.canvas);
    await report("Looking for faces…");
    const boxes = await findFaces(picture, find, settings.detector);
    const found = performance.now();
    const of = (index) => (boxes.length > 1 ? ` of face ${index + 1} of ${boxes.length}` : " of the face");
    faces = await readFaces(picture, boxes, halves, settings.network, (index) => report(`Reading the maps${of(index)}…`));
    if (!faces.length) throw new Problem(NO_FACE);
    show();
    await report(summary(found - start, performance.now() - found), "ready");
    tell({ faces: faces.map(inPhotograph) });
  } catch (error) {
    const problem = error instanceof Problem ? error.message : `Something went wrong: ${error.message}`;
    await report(problem, "failed");
    if (!(error instanceof Problem)) console.error(error);
    tell({ problem });
  }
}

const NO_FACE =
  "No face was found. Faces have to be upright: turn the photograph if it lies on its side. If the face is small, cut " +
  "it out of the photograph with some space around it.";

function summary(findingMs, readingMs) {
  const n = faces.length;
  const seconds = (ms) => `${(ms / 1000).toFixed(2)} s`;
  const each = n > 1 ? `, ${seconds(readingMs / n)} for each` : "";
  return `${n === 1 ? "1 face" : `${n} faces`}. Finding took ${seconds(findingMs)}, reading ${seconds(readingMs)}${each}.`;
}

const tell = (detail) => document.dispatchEvent(new CustomEvent("read", { detail }));

// The numbers of a face for other programs: pixels of the photograph itself, and not of the copy that is shown.
function inPhotograph({ box, score, landmarks }) {
  const scaled = (value) => Number((value / photograph.scale).toFixed(2));
  return {
    box: [box.left, box.top, box.right, box.bottom].map(scaled),
    score: Number(score.toFixed(3)),
    landmarks: landmarks.map(({ x, y }) => [scaled(x), scaled(y)]),
    visible: landmarks.map(({ isSeen }) => isSeen),
  };
}

function show() {
  const shown = {
    map: byId("map").value,
    opacity: byId("opacity").value / 100,
    landmarks: byId("show-landmarks").checked,
    boxes: byId("show-boxes").checked,
  };
  byId("opacity").disabled = shown.map === "none";
  byId("legend").textContent = faces.length ? LEGENDS[shown.map] : "";
  for (const id of ["save-picture", "save-landmarks"]) byId(id).disabled = !faces.length;
  byId("turn").disabled = !photograph;
  if (!photograph) return;
  drawFaces(byId("drawing"), photograph.canvas, faces, shown);
  document.body.dataset.has = "photograph";
}

function save(content, ending) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = `${photograph.name.replace(/\.[^.]*$/, "")}-${ending}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

function saveLandmarks() {
  const content = { photograph: photograph.name, frame: settings.frame, faces: faces.map(inPhotograph) };
  save(new Blob([JSON.stringify(content, null, 1)], { type: "application/json" }), "landmarks.json");
}

function take(files) {
  const [file] = files;
  if (file) enqueue(() => openPhotograph(file));
}

function listen() {
  byId("file").addEventListener("change", (event) => {
    take(event.target.files);
    event.target.value = ""; // so that the same file can be chosen again
  });
  for (const name of ["dragenter", "dragover", "dragleave", "drop"]) {
    document.addEventListener(name, (event) => {
      event.preventDefault();
      document.body.toggleAttribute("data-drop", name === "dragenter" || name === "dragover");
      if (name === "drop") take(event.dataTransfer.files);
    });
  }
  document.addEventListener("paste", (event) => take(event.clipboardData.files));
  for (const id of ["map", "opacity", "show-landmarks", "show-boxes"]) byId(id).addEventListener("input", show);
  byId("turn").addEventListener("click", () => {
    const own = photograph;
    enqueue(() => turned(own));
  });
  byId("save-picture").addEventListener("click", () => byId("drawing").toBlob((picture) => save(picture, "faces.png")));
  byId("save-landmarks").addEventListener("click", saveLandmarks);
  byId("licences").addEventListener("toggle", showNotices, { once: true });
}

async function showNotices() {
  byId("notices-text").textContent = new TextDecoder().decode(await unpacked("notices"));
}

async function start() {
  listen();
  show();
  networks = openNetworks(report);
  latest = networks.then(
    () => report("Ready. Choose a photograph.", "ready"),
    (error) => report(`The networks could not be loaded: ${error.message}. A newer browser may do it.`, "failed"),
  );
}

start();
