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
