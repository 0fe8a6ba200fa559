// Draws the figures, follows the theme, and keeps one time cursor, one zoom and one choice of detectors for the whole page.
"use strict";
const page = JSON.parse(document.getElementById("figures").textContent);
const figures = page.figures, root = document.documentElement, hidden = new Set();
const $ = (id) => document.getElementById(id);
const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"], doubleClick: false };

// A colour is the name of a CSS variable, "--blue" or "--blue/0.2": the same figure serves both themes
function colour(text, style) {
  const [name, alpha] = text.split("/");
  const value = style.getPropertyValue(name).trim();
  if (!alpha) return value;
  const n = parseInt(value.slice(1), 16);
  return `rgba(${n >> 16},${(n >> 8) & 255},${n & 255},${alpha})`;
}
function resolved(value, style) {
  if (typeof value === "string") return value.startsWith("--") ? colour(value, style) : value;
  if (Array.isArray(value)) return value.length && typeof value[0] === "number" ? value : value.map((v) => resolved(v, style));
  if (value && typeof value === "object") {
    const out = {};
    for (const k in value) out[k] = k === "bdata" ? value[k] : resolved(value[k], style);
    return out;
  }
  return value;
}
const shown = (o) => !(o.meta && hidden.has(o.meta.detector));
function draw(fig, range) {
  const style = getComputedStyle(root), layout = resolved(fig.layout, style), gd = $(fig.id);
  layout.annotations = (layout.annotations || []).filter((a) => !hidden.has(a.detector)).map(({ detector, ...a }) => a);
  const data = resolved(fig.data.filter(shown), style);
  if (fig.rows) {
    const rows = fig.rows.filter((r) => !hidden.has(r.detector)).map((r) => r.name);
    layout.yaxis.categoryarray = rows;
    layout.yaxis.range = [rows.length - 0.4, -0.6];
    layout.height = rows.length * 22 + 70;
    gd.style.height = layout.height + "px";
  }
  if (fig.time && range) for (const k in layout) if (/^xaxis/.test(k)) layout[k].range = range.slice();
  return Plotly.react(gd, data, layout, config);
}
let zoom = null, cursor = null;
const timed = figures.filter((f) => f.time);

async function drawAll() {
  for (const fig of figures) {
    await draw(fig, zoom);
    const gd = $(fig.id);
    if (fig.time && !gd.dataset.wired) wire(fig, gd);
    await new Promise((go) => setTimeout(go));
  }
  document.body.dataset.drawn = String(figures.length);
  placeCursor();
}
function wire(fig, gd) {
  gd.dataset.wired = "1";
  gd.on("plotly_relayout", (e) => {
    if (wire.busy) return;
    const key = Object.keys(e).find((k) => /^xaxis\d*\.range(\[0\])?$/.test(k));
    if (!key) { placeCursor(); return; }
    const axis = key.split(".")[0];
    setZoom(e[axis + ".range"] || [e[axis + ".range[0]"], e[axis + ".range[1]"]]);
  });
  gd.on("plotly_doubleclick", () => setZoom(page.span));
  gd.addEventListener("mousemove", (e) => {
    const box = gd.getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top;
    for (const a of panels(gd)) {
      const px = x - a.xaxis._offset, py = y - a.yaxis._offset;
      if (px >= 0 && px <= a.xaxis._length && py >= 0 && py <= a.yaxis._length) { setCursor(a.xaxis.p2l(px)); return; }
    }
  });
}
async function setZoom(range) {
  zoom = range.slice();
  wire.busy = true;
  for (const fig of timed) {
    const gd = $(fig.id), change = {};
    if (!gd.offsetParent) continue;
    for (const k in gd.layout) if (/^xaxis/.test(k)) change[k + ".range"] = range.slice();
    await Plotly.relayout(gd, change);
  }
  wire.busy = false;
  placeCursor();
}
const panels = (gd) => (gd._fullLayout ? Object.values(gd._fullLayout._plots || {}) : []);
function setCursor(t) {
  if (!page.span) return;
  cursor = Math.min(Math.max(t, page.span[0]), page.span[1]);
  placeCursor();
}
function mark(gd, i, kind) {
  const all = gd.getElementsByClassName(kind);
  if (all[i]) return all[i];
  const el = document.createElement("div");
  el.className = kind;
  gd.appendChild(el);
  return el;
}
function placeCursor() {
  if (cursor === null) return;
  for (const fig of timed) {
    const gd = $(fig.id);
    panels(gd).forEach((a, i) => {
      const el = mark(gd, i, "hair"), px = a.xaxis.l2p(cursor);
      el.style.display = px >= 0 && px <= a.xaxis._length ? "block" : "none";
      el.style.left = a.xaxis._offset + px + "px";
      el.style.top = a.yaxis._offset + "px";
      el.style.height = a.yaxis._length + "px";
    });
  }
  for (const fig of figures.filter((f) => f.track)) {
    const gd = $(fig.id), share = (cursor - page.span[0]) / (page.span[1] - page.span[0]);
    panels(gd).forEach((a, i) => {
      const path = fig.track[i];
      if (!path) return;
      const k = Math.min(path.x.length - 1, Math.round(share * (path.x.length - 1)));
      const el = mark(gd, i, "spot"), px = a.xaxis.l2p(path.x[k]), py = a.yaxis.l2p(path.y[k]);
      el.style.display = px >= 0 && px <= a.xaxis._length && py >= 0 && py <= a.yaxis._length ? "block" : "none";
      el.style.left = a.xaxis._offset + px + "px";
      el.style.top = a.yaxis._offset + py + "px";
    });
  }
  $("time").value = cursor;
  $("t").textContent = `t = ${cursor.toFixed(3)} s`;
  const on = (list) => list.filter((a) => a.from <= cursor && cursor <= a.to && !hidden.has(a.detector)).map((a) => a.text);
  const faults = on(page.faults), alarms = on(page.alarms);
  const broken = faults.length ? "fault: " + faults.join(", ") + " · " : page.faults ? "no fault · " : "";
  $("now").textContent = `${broken}${alarms.length ? "alarm: " + alarms.join(", ") : "no alarm"}`;
  $("now").title = $("now").textContent;
}

function setTheme(name) {
  root.dataset.theme = name;
  $("theme").textContent = name === "dark" ? "light" : "dark";
  return drawAll();
}
$("theme").addEventListener("click", () => setTheme(root.dataset.theme === "dark" ? "light" : "dark"));
if (page.span) {
  $("time").addEventListener("input", (e) => setCursor(Number(e.target.value)));
  $("reset").addEventListener("click", () => setZoom(page.span));
}
for (const chip of document.querySelectorAll("button.chip")) {
  chip.addEventListener("click", () => {
    const id = chip.dataset.toggle, off = !hidden.has(id);
    off ? hidden.add(id) : hidden.delete(id);
    chip.setAttribute("aria-pressed", String(!off));
    for (const el of document.querySelectorAll(`[data-detector="${id}"]`)) el.toggleAttribute("hidden", off);
    for (const fig of figures) {
      if (fig.data.some((t) => t.meta && t.meta.detector)) draw(fig, zoom);
      else if (fig.detector === id && !off) draw(fig, zoom);
    }
    placeCursor();
  });
}
for (const button of document.querySelectorAll("button.more")) {
  const words = button.textContent;
  button.addEventListener("click", () => {
    const all = button.parentElement.classList.toggle("all");
    button.setAttribute("aria-expanded", String(all));
    button.textContent = all ? "fewer columns" : words;
  });
}
let before = null, opened = [];
window.addEventListener("beforeprint", () => {  // paper is white and narrow
  before = root.dataset.theme;
  root.dataset.theme = "light";
  opened = [...document.querySelectorAll("details:not([open])")];
  for (const d of opened) d.open = true;
  for (const fig of figures) { $(fig.id).style.width = "690px"; draw(fig, zoom); Plotly.relayout($(fig.id), { width: 690 }); }
});
window.addEventListener("afterprint", () => {
  root.dataset.theme = before;
  for (const d of opened) d.open = false;
  for (const fig of figures) { $(fig.id).style.width = ""; draw(fig, zoom); }
});
window.addEventListener("resize", () => setTimeout(placeCursor, 200));
setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light").then(() => { if (page.span) setCursor(page.start); });
