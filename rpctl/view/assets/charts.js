/* The plots: uPlot charts on one time axis, with a cursor at the time that the scene shows. */

const HEIGHT = 146; // px of a chart
const READ = 100; // ms between two readings of the values while the scene plays
const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const PREFIXED = { m: ["", "m", "µ"], rad: ["", "m", "µ"] };

function bytes(text) { return Uint8Array.from(atob(text), (char) => char.charCodeAt(0)); }

function floats(text) { return new Float32Array(bytes(text).buffer); }

/* Return a value with its unit, lengths and angles with the prefix that suits them. */
function told(value, unit) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const prefixes = PREFIXED[unit] || [""];
  let size = Math.abs(value), power = 0;
  while (size < 1 && power < prefixes.length - 1 && size > 0) { size *= 1000; power += 1; }
  if (power === prefixes.length - 1 && size < 0.01) { size = 0; power = 0; }
  const digits = size >= 100 ? 0 : size >= 10 ? 1 : 2;
  const sign = value < 0 && Number(size.toFixed(digits)) !== 0 ? "−" : "";
  return `${sign}${size.toFixed(digits)} ${prefixes[power]}${unit}`.trim();
}

/* Return the powers of ten from one value to another. */
function powers(low, high) {
  const first = Math.ceil(Math.log10(low)), last = Math.floor(Math.log10(high));
  return Array.from({ length: last - first + 1 }, (_, k) => 10 ** (first + k));
}

function superscript(power) {
  const exponent = Math.round(Math.log10(power));
  const digits = [...String(Math.abs(exponent))].map((digit) => SUPERSCRIPTS[digit]).join("");
  return `10${exponent < 0 ? "⁻" : ""}${digits}`;
}

/* An element whose text breaks after the separators of names, too. */
function nameElement(kind, className, text) {
  const made = element(kind, className);
  for (const word of text.split(/(?<=[_\-/.:])/)) made.append(word, document.createElement("wbr"));
  return made;
}

function makeCharts(data, host, seek) {
  const x = floats(data.plots.x), end = x[x.length - 1];
  let colours = {}, now = 0, read = 0, hovered = null, zooming = false;
  const all = data.plots.charts.map((chart) => makeChart(chart));
  new ResizeObserver(() => all.forEach((chart) => chart.resize())).observe(host);
  return { all, show, paint, whole: () => zoom(x[0], end) };

  function show(time, playing) {
    now = time;
    for (const chart of all) chart.mark();
    if (hovered !== null || (playing && performance.now() - read < READ)) return;
    readAt(nearest(now));
  }

  function readAt(index) {
    read = performance.now();
    for (const chart of all) chart.read(index);
  }

  function nearest(time) {
    let low = 0, high = x.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (x[middle] <= time) low = middle; else high = middle;
    }
    return time - x[low] < x[high] - time ? low : high;
  }

  function paint() {
    colours = { ink: css("--ink"), soft: css("--soft"), line: css("--line") };
    for (let k = 0; k < PALETTE; k++) colours[k] = css(`--c${k}`);
    for (const chart of all) chart.redraw();
  }

  function zoom(min, max) {
    if (zooming) return;
    zooming = true;
    for (const chart of all) chart.zoom(min, max);
    zooming = false;
    document.getElementById("whole").hidden = min <= x[0] && max >= end;
  }

  function makeChart(chart) {
    const card = element("section", "chart"), head = element("header");
    const title = element("h3", "", chart.title), unit = element("span", "unit");
    const note = element("span", "note"), at = element("span", "at"), plot = element("div", "plot"), keys = element("div", "keys");
    plot.setAttribute("role", "img");
    plot.setAttribute("aria-label", `Plot over time: ${chart.title}`);
    keys.setAttribute("role", "group");
    keys.setAttribute("aria-label", `Lines of ${chart.title}`);
    head.append(title, unit, note, at);
    card.append(head, plot, keys);
    host.append(card);
    let variant = chart.variants[0], decades = false, u = null;
    let values = [], edges = [], buttons = [], cursor = null;
    if (chart.variants.length > 1) head.insertBefore(chooser(), at);
    if (variant.decades) head.append(scaleButton());
    build();
    return { mark, read: readLines, redraw: () => u.redraw(false), resize, zoom: rescale,
      get plot() { return u; }, title: chart.title };

    function chooser() {
      const choice = element("select");
      choice.setAttribute("aria-label", `Quantity shown in ${chart.title}`);
      for (const each of chart.variants) choice.append(element("option", "", each.label));
      choice.addEventListener("change", () => {
        variant = chart.variants[choice.selectedIndex];
        build();
      });
      return choice;
    }

    function scaleButton() {
      const button = element("button", "scale", "log");
      button.type = "button";
      button.setAttribute("aria-label", `Logarithmic axis of ${chart.title}`);
      button.setAttribute("aria-pressed", "false");
      button.addEventListener("click", () => {
        decades = !decades;
        button.setAttribute("aria-pressed", String(decades));
        build();
      });
      return button;
    }

    /* Draw the chart anew: another line was chosen, or another axis. */
    function build() {
      const range = u && [u.scales.x.min, u.scales.x.max];
      if (u) u.destroy();
      unit.textContent = variant.unit + (decades ? ", absolute value" : "");
      note.textContent = variant.note;
      values = variant.lines.map((line) => floats(line.values));
      edges = variant.lines.map((line) => line.band && line.band.map(floats));
      const shown = [], series = [{}], bands = [];
      variant.lines.forEach((line, i) => {
        if (edges[i]) {
          bands.push({ series: [series.length + 1, series.length], fill: () => shade(line, "1c") });
          for (const edge of edges[i]) {
            shown.push(prepared(edge.map((value) => Math.min(value, highest()))));
            series.push({ ...style(line, false, i), stroke: () => shade(line, "60"), width: 1 });
          }
        }
        for (const [drawn, wanted] of [[line.reference, true], [line.values, false]]) {
          if (!drawn) continue;
          shown.push(prepared(wanted ? floats(drawn) : values[i]));
          series.push(style(line, wanted, i));
        }
      });
      cursor = element("div", "now");
      u = new uPlot({ ...options(series), bands }, [x, ...shown], plot);
      u.over.append(cursor);
      u.over.addEventListener("click", (event) => {
        seek(u.posToVal(event.offsetX, "x"));
        if (event.pointerType === "touch") u.setCursor({ left: -10, top: -10 }); // no finger hovers
      });
      if (range) rescale(...range);
      legend();
      readLines(nearest(now));
    }

    function prepared(line) {
      if (decades) line = line.map((value) => Math.max(Math.abs(value), variant.noise / 10));
      return line.some(Number.isNaN)
        ? Array.from(line, (value) => (Number.isNaN(value) ? null : value)) : line;
    }

    function style(line, wanted, i) {
      const turn = Math.floor(line.colour / PALETTE);
      return {
        line: i, show: line.shown, scale: "y", points: { show: false }, pxAlign: 0,
        stroke: () => colours[line.colour % PALETTE] || "#888", alpha: wanted ? 0.65 : 1,
        width: wanted ? 1.1 : 1.5, dash: wanted ? [3, 3] : turn ? [9, 3] : undefined,
      };
    }

    /* The colour of what lies between the least and the largest value of a line; alpha in hex. */
    function shade(line, alpha) { return `${colours[line.colour % PALETTE] || "#888888"}${alpha}`; }

    /* Return how far the axis reaches: a band without an end stops there. */
    function highest() {
      return [...values, ...edges.flatMap((band) => band || [])].reduce((top, line) => line.reduce(
        (most, value) => (value > most && value < Infinity ? value : most), top),
      Math.max(0, ...variant.limits));
    }

    function options(series) {
      const [across, up] = chartAxes(() => colours.soft || "#666", () => colours.line || "#ccc");
      return {
        width: Math.max(plot.clientWidth, 120), height: HEIGHT, legend: { show: false },
        padding: [8, 16, 0, 0], series,
        scales: { x: { time: false, range: (_, min, max) => [min, max] }, y: scaleY() },
        axes: [
          across,
          { ...up, size: 54, space: 26, ...(decades ? {
            splits: (_, at, low, high) => powers(low, high), filter: (_, splits) => splits,
            values: (_, splits) => splits.map((power) => superscript(power * variant.factor)),
          } : { values: (_, splits) => splits.map((at) => plain(at * (variant.factor || 1))) }) },
        ],
        focus: { alpha: 0.25 },
        cursor: {
          y: false, drag: { x: true, y: false, dist: 6 }, focus: { prox: 16 },
          points: { size: 6 }, sync: { key: "rpctl", setSeries: false, scales: ["x", null] },
        },
        hooks: {
          drawAxes: [limits], draw: [mark], setCursor: [hover],
          setScale: [(self, name) => {
            if (name === "x" && self.status) zoom(self.scales.x.min, self.scales.x.max);
          }],
          setSeries: [(self, i, change) => {
            if (change.focus !== undefined) focus(i === null ? null : self.series[i].line);
          }],
        },
      };
    }

    function scaleY() {
      if (decades) return { distr: 3, log: 10, range: () => variant.decades };
      return { range: (_, low, high) => {
        low = Math.min(low ?? 0, ...variant.limits);
        high = Math.max(high ?? 1, ...variant.limits);
        if (variant.noise) [low, high] = [Math.min(low, -variant.noise), Math.max(high, variant.noise)];
        const room = 0.06 * (high - low) || Math.max(Math.abs(high), 1e-9);
        return [low - room, high + room];
      } };
    }

    function limits(self) { drawLimits(self, variant.limits, colours.ink || "#000"); }

    /* The lines' names: each shows or hides its line, and tells its value. */
    function legend() {
      buttons = variant.lines.map((line, i) => {
        const button = element("button", "key"), swatch = element("i");
        button.type = "button";
        button.setAttribute("aria-pressed", String(line.shown));
        swatch.style.color = `var(--c${line.colour % PALETTE})`;
        if (line.colour >= PALETTE) swatch.style.borderTopStyle = "dashed";
        const name = nameElement("span", "label", line.label);
        name.title = (variant.names || "…").replace("…", line.label);
        button.append(swatch, name, element("b"));
        button.addEventListener("click", () => {
          const on = button.getAttribute("aria-pressed") !== "true";
          button.setAttribute("aria-pressed", String(on));
          linesOf(i).forEach((k) => u.setSeries(k, { show: on }));
        });
        button.addEventListener("mouseenter", () => u.setSeries(linesOf(i).at(-1), { focus: true }));
        button.addEventListener("mouseleave", () => u.setSeries(null, { focus: true }));
        return button;
      });
      keys.replaceChildren(...(variant.names ? [nameElement("span", "names", variant.names)] : []),
        ...buttons);
    }

    function linesOf(i) {
      return u.series.flatMap((series, k) => (series.line === i ? [k] : []));
    }

    function focus(i) {
      buttons.forEach((button, k) => button.classList.toggle("near", k === i));
    }

    function hover(self) {
      const index = self.cursor.left >= 0 ? self.cursor.idx : null;
      if (index === hovered) return;
      hovered = index;
      readAt(index ?? nearest(now));
    }

    function readLines(index) {
      at.textContent = hovered === null ? "" : `at ${x[index].toFixed(2)} s`;
      variant.lines.forEach((line, i) => {
        const [low, high] = (edges[i] || []).map((edge) => edge[index]);
        const one = low === undefined || Number.isNaN(low), bare = told(low, "").trim();
        buttons[i].lastChild.textContent = one ? told(values[i][index], line.unit)
          : high === Infinity ? `≥ ${told(low, line.unit)}` : `${bare} – ${told(high, line.unit)}`;
      });
    }

    function mark() {
      const { min, max } = u.scales.x;
      cursor.style.visibility = now < min || now > max ? "hidden" : "";
      cursor.style.transform = `translateX(${u.valToPos(now, "x")}px)`;
    }

    function rescale(min, max) {
      if (u.scales.x.min !== min || u.scales.x.max !== max) u.setScale("x", { min, max });
    }

    function resize() {
      if (!plot.clientWidth) return;
      u.setSize({ width: plot.clientWidth, height: HEIGHT });
    }
  }
}
