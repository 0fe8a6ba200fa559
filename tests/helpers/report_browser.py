"""Open a report in a headless Chromium, let a script use it as a reader would, and return what came of it."""

import html
import json
import re
import shutil
import subprocess

CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-dev-shm-usage --hide-scrollbars"
).split()

# runs before the page's own scripts: keeps every error, and lets no request leave the file
BEFORE = """<script>window.found = {errors: [], requests: []};
window.addEventListener("error", (e) => found.errors.push(String(e.message)));
window.addEventListener("unhandledrejection", (e) => found.errors.push("rejected: " + e.reason));
for (const kind of ["error", "warn"]) {
  const old = console[kind].bind(console);
  console[kind] = (...a) => { found.errors.push(kind + ": " + a.join(" ")); old(...a); };
}
const asked = window.fetch;
window.fetch = (...a) => { found.requests.push(String(a[0])); return asked(...a); };</script>"""

# runs after them: waits until all is drawn, then clicks, moves and reads
AFTER = """<script>(async () => {
const wait = (ms) => new Promise((go) => setTimeout(go, ms));
const until = async (test) => { for (let i = 0; i < 400 && !test(); i++) await wait(25); };
const $ = (s) => [...document.querySelectorAll(s)];
const MARKS = ".scatterlayer path, .barlayer path, .heatmaplayer image";
const count = (p, s) => p.querySelectorAll(s).length;
const drawn = () => $(".plot").map((p) => ({id: p.id, svg: count(p, ".main-svg"), width: p.clientWidth,
  traces: (p._fullData || []).length, marks: count(p, MARKS)}));
try {
  await until(() => document.body.dataset.drawn);
  await wait(100);
  found.plots = drawn();
  found.overflow = document.documentElement.scrollWidth > document.documentElement.clientWidth + 1;
  const theme = document.documentElement.dataset.theme, before = getComputedStyle(document.body).backgroundColor;
  delete document.body.dataset.drawn;
  document.getElementById("theme").click();
  await until(() => document.body.dataset.drawn);
  const after = getComputedStyle(document.body).backgroundColor;
  found.theme = [theme, document.documentElement.dataset.theme, before, after];
  const chip = $("button.chip")[0], id = chip.dataset.toggle;
  const line = document.getElementById("timeline");
  const rows = () => (line ? line.layout.yaxis.categoryarray.length : 0);
  const own = () => $(`[data-detector="${id}"]`).filter((e) => e.offsetParent !== null).length;
  found.toggle = {id, before: own(), rows_before: rows()};
  chip.click();
  await wait(300);
  Object.assign(found.toggle, {off: own(), rows_off: rows(), pressed: chip.getAttribute("aria-pressed")});
  chip.click();
  await wait(300);
  Object.assign(found.toggle, {on: own(), rows_on: rows()});
  const motion = document.getElementById("motion");
  if (motion) {
    motion.scrollIntoView();
    const box = motion.getBoundingClientRect(), axis = motion._fullLayout.xaxis;
    const x = axis._offset + 0.25 * axis._length, y = motion._fullLayout.yaxis._offset + 10;
    motion.dispatchEvent(new MouseEvent("mousemove", {clientX: box.left + x, clientY: box.top + y, bubbles: true}));
    await wait(100);
    found.cursor = {text: document.getElementById("t").textContent, now: document.getElementById("now").textContent,
      expected: axis.p2l(0.25 * axis._length), hairs: $(".hair").filter((e) => e.style.display === "block").length,
      spots: $(".spot").filter((e) => e.style.display === "block").length};
    await Plotly.relayout(motion, {"xaxis.range[0]": 1, "xaxis.range[1]": 2});
    await wait(500);
    found.zoom = ["timeline", "elevators"].map((n) => document.getElementById(n).layout.xaxis.range.map(Number));
  }
} catch (e) { found.errors.push("script: " + e + (e.stack || "")); }
const out = document.createElement("pre");
out.id = "found";
out.textContent = JSON.stringify(found);
document.body.appendChild(out);
})();</script>"""


def use(page, folder, width=1280):
    """Return what the script found on the page at `page`, as a dict; `folder` takes the browser's profile."""
    copy = folder / f"{page.stem}-used.html"
    text = page.read_text(encoding="utf-8").replace("<head>", "<head>" + BEFORE, 1)
    copy.write_text(text.replace("</body></html>", AFTER + "</body></html>"), encoding="utf-8")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900"]
    command += ["--virtual-time-budget=60000", "--dump-dom", copy.as_uri()]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True).stdout
    found = re.search(r'<pre id="found">(.*?)</pre>', dom, re.S)
    assert found, "the page's script did not end"
    return json.loads(html.unescape(found.group(1)))
