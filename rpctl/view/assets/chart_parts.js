/* What charts of a report and of a live page share: colours, elements, axes, limits. */

const PALETTE = 12; // colours --c0 to --c11 of the style sheet

function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function plain(value) { return String(Number(value.toPrecision(6))).replace("-", "−"); }

function element(kind, className, text) {
  const made = document.createElement(kind);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}

/* Return the axes of a uPlot chart, of time and of values, in colours of text and of lines. */
function chartAxes(ink, tick) {
  const axis = { stroke: ink, font: "11px system-ui, sans-serif",
    grid: { stroke: tick, width: 1 }, ticks: { stroke: tick, width: 1, size: 4 } };
  return [
    { ...axis, size: 26, gap: 3, space: 60, values: (_, splits) => splits.map(
      (t, i) => `${Number(t.toFixed(4))}${i === splits.length - 1 ? " s" : ""}`) },
    { ...axis, size: 46, gap: 4, space: 20, values: (_, splits) => splits.map(plain) },
  ];
}

/* Draw the limits of a uPlot chart: dashed, across all of it. */
function drawLimits({ ctx, bbox, valToPos }, limits, colour) {
  ctx.save();
  ctx.strokeStyle = colour;
  ctx.lineWidth = devicePixelRatio;
  ctx.setLineDash([6, 4].map((n) => n * devicePixelRatio));
  for (const limit of limits) {
    const y = Math.round(valToPos(limit, "y", true));
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  }
  ctx.restore();
}
