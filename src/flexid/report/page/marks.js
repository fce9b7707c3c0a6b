// Marks of a panel on uPlot's canvas: lines, bands, points and levels, from the back to the front.

// Points of a figure in print, as pixels of a screen.
const PIXELS = 96 / 72;

const DASHES = { solid: [], dashed: [6, 4], dotted: [1.5, 3] };

// What a colour is by day or by night: page.css says it.
function shade(element, colour) {
  return getComputedStyle(element).getPropertyValue(`--chart-${colour}`).trim();
}

function drawMarks(plot, panel, hidden) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  for (const mark of panel.marks) {
    if (hidden.has(mark.label)) continue;
    ctx.save();
    const colour = shade(plot.root, mark.colour);
    ctx.strokeStyle = colour;
    ctx.fillStyle = colour;
    DRAWN[mark.kind](plot, mark);
    ctx.restore();
  }
  ctx.restore();
}

const DRAWN = {
  line(plot, mark) {
    const { ctx } = plot;
    if (mark.filled) {
      ctx.globalAlpha = 0.14;
      ctx.beginPath();
      trace(plot, mark.x, mark.y);
      ctx.fill();
      ctx.globalAlpha = 1;
    }
    ctx.beginPath();
    trace(plot, mark.x, mark.y);
    stroke(plot, mark.width, mark.dash);
  },

  band(plot, mark) {
    const { ctx } = plot;
    ctx.globalAlpha = 0.24;
    for (const [start, stop] of stretches(mark)) {
      const x = mark.x.slice(start, stop);
      ctx.beginPath();
      trace(plot, x, mark.high.slice(start, stop));
      trace(plot, [...x].reverse(), mark.low.slice(start, stop).reverse(), true);
      ctx.fill();
    }
  },

  points(plot, mark) {
    const { ctx, bbox } = plot;
    const radius = (mark.size / 2) * PIXELS * devicePixelRatio;
    ctx.globalAlpha = mark.faint ? 0.25 : 1;
    ctx.beginPath();
    for (let i = 0; i < mark.x.length; i++) {
      const place = placeOf(plot, mark.x[i], mark.y[i]);
      if (!place) continue;
      ctx.moveTo(place[0] + radius, place[1]);
      ctx.arc(place[0], place[1], radius, 0, 2 * Math.PI);
    }
    ctx.fill();
    if (!mark.stems) return;
    ctx.beginPath();
    for (let i = 0; i < mark.x.length; i++) {
      const place = placeOf(plot, mark.x[i], mark.y[i]);
      if (!place) continue;
      ctx.moveTo(place[0], bbox.top + bbox.height);
      ctx.lineTo(place[0], place[1]);
    }
    stroke(plot, 1.3, "solid");
  },

  level(plot, mark) {
    const { ctx, bbox } = plot;
    const along = plot.valToPos(mark.value, mark.along, true);
    ctx.beginPath();
    if (mark.along === "x") {
      ctx.moveTo(along, bbox.top);
      ctx.lineTo(along, bbox.top + bbox.height);
    } else {
      ctx.moveTo(bbox.left, along);
      ctx.lineTo(bbox.left + bbox.width, along);
    }
    stroke(plot, 0.9, mark.dash);
  },
};

function stroke(plot, width, dash) {
  plot.ctx.lineWidth = width * PIXELS * devicePixelRatio;
  plot.ctx.lineJoin = "round";
  plot.ctx.setLineDash(DASHES[dash].map((length) => length * devicePixelRatio));
  plot.ctx.stroke();
}

// A path through points, with gaps; one that goes on has none at its start.
function trace(plot, x, y, goesOn = false) {
  let drawing = goesOn;
  for (let i = 0; i < x.length; i++) {
    const place = placeOf(plot, x[i], y[i]);
    if (place && drawing) plot.ctx.lineTo(...place);
    else if (place) plot.ctx.moveTo(...place);
    drawing = Boolean(place);
  }
}

function placeOf(plot, x, y) {
  if (!shown(plot.scales.x, x) || !shown(plot.scales.y, y)) return null;
  return [plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)];
}

// A logarithmic axis has no place for zero.
function shown(scale, value) {
  return value !== null && (scale.distr !== 3 || value > 0);
}

// Where both ends of a band are known.
function* stretches(mark) {
  let start = null;
  for (let i = 0; i <= mark.x.length; i++) {
    const known = i < mark.x.length && mark.low[i] !== null && mark.high[i] !== null;
    if (known && start === null) start = i;
    if (!known && start !== null) {
      yield [start, i];
      start = null;
    }
  }
}
