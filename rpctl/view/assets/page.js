/* The page: one time for scene and plots, and the controls that set it. */

const $ = (id) => document.getElementById(id);
const data = JSON.parse($("rpctl-data").textContent);
const duration = data.duration;
const PLAY = "M7 4.5v15l13-7.5z", PAUSE = "M6 4.5h4.2v15H6zM13.8 4.5H18v15h-4.2z";
const SKIP = 1, STEP = 0.1; // s that an arrow key moves, and with Shift

let time = 0, playing = false, speed = 1, last = null;

const dark = window.matchMedia("(prefers-color-scheme: dark)");
const night = darkRules();
const charts = makeCharts(data, $("plots"), show);
const scene = makeScene(data, $("scene"));
if (!scene) {
  $("failure").hidden = false;
  document.body.classList.add("flat");
}
controls();
legend();
tabs();
theme(dark.matches);
show(0);
const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
window.rpctl = {
  viewer: scene && scene.viewer, charts: charts.all, duration, seek: show, play, pause,
  camera: (name) => scene && scene.camera(name), time: () => time, playing: () => playing,
  ready: scene !== null,
};
setPlaying(!still && duration > 0);
requestAnimationFrame(tick);

// ---- time -------------------------------------------------------------------------------

function tick(now) {
  if (playing && last !== null) {
    const next = time + speed * (now - last) / 1000;
    show(next > duration ? 0 : next);
  }
  last = now;
  requestAnimationFrame(tick);
}

function show(t) {
  time = Math.min(Math.max(t, 0), duration);
  $("scrubber").value = time;
  $("scrubber").setAttribute("aria-valuetext", `${time.toFixed(1)} seconds`);
  $("clock").textContent = `${time.toFixed(2)} / ${duration.toFixed(2)} s`;
  charts.show(time, playing);
  if (scene) scene.show(time);
}

function play() { setPlaying(true); }

function pause() { setPlaying(false); }

function setPlaying(on) {
  playing = on;
  $("play-icon").setAttribute("d", on ? PAUSE : PLAY);
  $("play").setAttribute("aria-label", on ? "Pause" : "Play");
}

function setSpeed(step) {
  const choices = $("speed");
  const index = choices.selectedIndex + step;
  choices.selectedIndex = Math.min(Math.max(index, 0), choices.length - 1);
  speed = Number(choices.value);
}

// ---- controls ---------------------------------------------------------------------------

function controls() {
  $("play").addEventListener("click", () => setPlaying(!playing));
  $("scrubber").addEventListener("input", (event) => show(Number(event.target.value)));
  $("speed").addEventListener("change", () => setSpeed(0));
  $("theme").addEventListener("click", () => theme(!isDark()));
  $("whole").addEventListener("click", () => charts.whole());
  dark.addEventListener("change", () => theme(dark.matches));
  for (const name of ["home", "top", "follow"])
    $(`camera-${name}`).addEventListener("click", () => scene && scene.camera(name));
  window.addEventListener("keydown", key);
}

function key(event) {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  const at = event.target.closest("select, summary, button, [role=tablist]");
  if (at && at.matches("select, [role=tablist], [role=tab]")) return;
  if (at && at.id !== "play" && (event.key === " " || event.key === "Enter")) return;
  const step = event.shiftKey ? STEP : SKIP;
  const moves = {
    " ": () => setPlaying(!playing), ArrowLeft: () => show(time - step),
    ArrowRight: () => show(time + step), Home: () => show(0),
    End: () => { pause(); show(duration); }, "+": () => setSpeed(1), "-": () => setSpeed(-1),
    r: () => scene && scene.camera("home"), t: () => scene && scene.camera("top"),
    f: () => scene && scene.camera("follow"), d: () => theme(!isDark()),
  };
  if (!(event.key in moves)) return;
  event.preventDefault();
  moves[event.key]();
}

/* Each entry of the scene's legend shows or hides what it names. */
function legend() {
  for (const entry of document.querySelectorAll("[data-layer]")) {
    const shown = () => entry.getAttribute("aria-pressed") === "true";
    const key = document.querySelector(`[data-key="${entry.dataset.layer}"]`);
    const apply = () => {
      if (key) key.hidden = !shown();
      if (scene) scene.layer(entry.dataset.layer, shown());
    };
    entry.addEventListener("click", () => {
      entry.setAttribute("aria-pressed", String(!shown()));
      apply();
    });
    apply();
  }
}

function tabs() {
  const all = [...document.querySelectorAll("[role=tab]")];
  const select = (chosen) => {
    for (const tab of all) {
      const on = tab === chosen;
      tab.setAttribute("aria-selected", String(on));
      tab.tabIndex = on ? 0 : -1;
      $(tab.getAttribute("aria-controls")).hidden = !on;
    }
    document.body.classList.toggle("reading", chosen.id === "tab-details");
  };
  all.forEach((tab, i) => {
    tab.addEventListener("click", () => select(tab));
    tab.addEventListener("keydown", (event) => {
      if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
      const next = all[(i + 1) % all.length];
      select(next);
      next.focus();
    });
  });
}

// ---- light and dark -----------------------------------------------------------------------

/* The page's dark colours stand in one media rule: what it asks for is what switches it. */
function darkRules() {
  const rules = [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules]);
  return rules.filter((rule) => rule.media && rule.media.mediaText.includes("dark"));
}

function isDark() { return $("theme").getAttribute("aria-pressed") === "true"; }

function theme(on) {
  for (const rule of night) rule.media.mediaText = on ? "all" : "not all";
  $("theme").setAttribute("aria-pressed", String(on));
  charts.paint();
  if (scene) scene.paint();
}
