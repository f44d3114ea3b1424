/* Charts that grow while a simulation runs: errors, and efforts against their limits. */
function makeLiveCharts(charts, host) {
  const HEIGHT = 118; // px of a chart
  const POINTS = 2400; // of a line; beyond, of every two the larger stays
  const PAUSE = 100; // ms between two drawings
  const NOISE = 0.001; // mm or mrad: smaller errors are noise, to which no axis is scaled
  let x = [], end = 1, drawn = 0, waiting = false;
  const all = charts.filter((chart) => chart.lines.length).map(makeChart);
  new ResizeObserver(() => all.forEach((chart) => chart.resize())).observe(host);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  return { begin, add };

  /* Empty the charts for a motion of a duration (s). */
  function begin(duration) {
    [x, end] = [[], duration];
    for (const chart of all) chart.lines.forEach((_, i) => { chart.lines[i] = []; });
    draw();
  }

  /* Add a moment: its time (s), and the values of each chart's lines. */
  function add(time, values) {
    x.push(time);
    for (const chart of all) chart.lines.forEach((line, i) => line.push(values[chart.number][i]));
    if (x.length > POINTS) thin();
    if (waiting) return;
    waiting = true;
    setTimeout(draw, Math.max(0, PAUSE - (performance.now() - drawn)));
  }

  function thin() {
    const larger = (a, b) => (Math.abs(b) > Math.abs(a) ? b : a);
    const halved = (line, choose) => line.filter((_, k) => k % 2 === 0)
      .map((value, k) => (2 * k + 1 < line.length ? choose(value, line[2 * k + 1]) : value));
    x = halved(x, (a) => a);
    for (const chart of all) chart.lines.forEach((line, i) => { chart.lines[i] = halved(line, larger); });
  }

  function draw() {
    [waiting, drawn] = [false, performance.now()];
    for (const chart of all) chart.draw();
  }

  function makeChart({ title, unit, limits, lines: names, names: shared }) {
    const made = (kind, parent, className, text) => {
      const child = element(kind, className, text);
      parent.append(child);
      return child;
    };
    const card = made("section", host, "chart", ""), head = made("header", card, "", "");
    made("h3", head, "", title);
    made("span", head, "unit", unit);
    if (limits.length) made("span", head, "note", "dashed: limits");
    const plot = made("div", card, "plot", ""), keys = made("div", card, "keys", "");
    plot.setAttribute("role", "img");
    plot.setAttribute("aria-label", `Plot over time: ${title}`);
    if (shared) made("span", keys, "names", shared);
    const values = names.map((name, i) => {
      const key = made("span", keys, "key", "");
      made("i", key, "", "").style.color = `var(--c${i % PALETTE})`;
      made("span", key, "label", name).title = name;
      return made("b", key, "", "");
    });
    const lines = names.map(() => []);
    const u = new uPlot({
      width: Math.max(plot.clientWidth, 120), height: HEIGHT, legend: { show: false },
      padding: [6, 12, 0, 0], cursor: { show: false },
      series: [{}, ...names.map((_, i) => ({
        stroke: () => css(`--c${i % PALETTE}`), width: 1.5, points: { show: false }, pxAlign: 0,
        dash: i < PALETTE ? undefined : [9, 3] }))],
      scales: { x: { time: false, range: () => [0, end] }, y: { range: reach } },
      axes: chartAxes(() => css("--soft"), () => css("--line")),
      hooks: { drawAxes: [dashes] },
    }, [[], ...lines], plot);
    return { number: charts.findIndex((chart) => chart.title === title), lines, draw: refresh,
      resize: () => plot.clientWidth && u.setSize({ width: plot.clientWidth, height: HEIGHT }) };

    function refresh() {
      u.setData([x, ...lines]);
      lines.forEach((line, i) => {
        values[i].textContent = line.length ? told(line[line.length - 1]) : "";
      });
    }

    function told(value) {
      const text = value.toFixed(Math.abs(value) < 9.995 ? 2 : Math.abs(value) < 99.95 ? 1 : 0);
      return text.replace(/^-(?=[0.]*$)/, "").replace("-", "−");
    }

    function reach(_, low, high) {
      low = Math.min(low ?? 0, 0, ...limits);
      high = Math.max(high ?? 1, NOISE, ...limits);
      const room = 0.08 * (high - low) || 1;
      return [low < 0 ? low - room : 0, high + room];
    }

    function dashes(self) { drawLimits(self, limits, css("--ink")); }
  }
}
