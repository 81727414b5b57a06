"use strict";
// Everything that came out of a file is set as text, never as markup.
const set = JSON.parse(document.getElementById("samples").textContent);
const at = (id) => document.getElementById(id);
let sample = 0;
const layers = set.layers.map(([name]) => name);
let layer = layers[0] || "";

function attributeTable([part, lines]) {
  const table = document.createElement("table");
  if (part) table.createCaption().textContent = part;
  for (const [label, value, name] of lines) {
    const row = table.insertRow();
    row.title = name;
    row.insertCell().textContent = label;
    row.insertCell().textContent = value;
  }
  return table;
}

function drawLandmarks(shown) {
  const svg = at("landmarks");
  svg.setAttribute("viewBox", `0 0 ${shown.width} ${shown.height}`);
  svg.replaceChildren();
  for (const [x, y, visible] of shown.landmarks) {
    const dot = document.createElementNS("http://www.w3.org/2000/svg", "circle");
    dot.setAttribute("cx", x);
    dot.setAttribute("cy", y);
    dot.setAttribute("r", Math.max(shown.width, shown.height) / 150);
    dot.setAttribute("fill", visible ? "#3cff3c" : "#ff5050");
    svg.append(dot);
  }
  svg.toggleAttribute("hidden", !at("dots").checked);
}

function picture(element, source) {
  element.toggleAttribute("hidden", !source);
  if (source) element.src = source;
}

function show() {
  const shown = set.samples[sample];
  at("stage").style.aspectRatio = `${shown.width} / ${shown.height}`;
  picture(at("picture"), shown.image);
  picture(at("overlay"), shown.layers[layer]);
  at("overlay").style.opacity = at("opacity").value / 100;
  drawLandmarks(shown);
  at("place").textContent = `${sample + 1} of ${set.samples.length}`;
  at("name").textContent = shown.id;
  at("layer").value = layer;
  at("legend").textContent = set.layers.filter(([name]) => name === layer).map((one) => one[2]).join("");
  at("attributes").replaceChildren(...shown.attributes.map(attributeTable));
  at("regions").toggleAttribute("hidden", !layer.endsWith("regions"));
}

function step(list, value, by) {
  return list[(list.indexOf(value) + by + list.length) % list.length];
}

function turn(by) {
  sample = (sample + by + set.samples.length) % set.samples.length;
  show();
}

function change(by) {
  if (layers.length) layer = step(layers, layer, by);
  show();
}

for (const [name, title] of set.layers) at("layer").append(new Option(title, name));
set.regions.forEach(([name, colour]) => {
  const row = at("regions").insertRow();
  const swatch = document.createElement("span");
  swatch.className = "swatch";
  swatch.style.backgroundColor = colour;
  row.insertCell().append(swatch, name);
});
at("layer").addEventListener("change", (event) => { layer = event.target.value; show(); });
at("opacity").addEventListener("input", show);
at("dots").addEventListener("change", show);
at("previous").addEventListener("click", () => turn(-1));
at("next").addEventListener("click", () => turn(1));
document.addEventListener("keydown", (event) => {
  if (event.target === at("opacity") || event.altKey || event.ctrlKey || event.metaKey) return;
  const moves = { ArrowLeft: [turn, -1], ArrowRight: [turn, 1], ArrowUp: [change, -1], ArrowDown: [change, 1] };
  if (!(event.key in moves)) return;
  event.preventDefault();
  const [move, by] = moves[event.key];
  move(by);
});
show();
