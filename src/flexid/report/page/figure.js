// Figures: panels drawn with uPlot, a legend that hides, buttons and keys that zoom.

const figures = new Map(); // by the element that holds them
let drawings = 0;

// Draw a chart document into an element, in place of what is there.
function draw(element, chart) {
  forget(element);
  const figure = {
    element,
    chart: unpacked(chart),
    hidden: new Set(),
    panels: [],
    number: (drawings += 1),
  };
  figures.set(element, figure);
  element.classList.add("chart-figure");
  const bar = make("div", "chart-bar");
  figure.legend = make("div", "chart-legend", bar);
  bar.append(buttonsOf(figure));
  figure.grid = make("div", "chart-panels");
  element.replaceChildren(bar, figure.grid, (figure.data = tablesOf(figure)));
  fill(figure);
  figure.watch = new ResizeObserver(() => fit(figure));
  figure.watch.observe(element);
}

// Show other data in a figure; what was zoomed or hidden stays so where it is the same figure.
function update(element, chart) {
  const figure = figures.get(element);
  const next = unpacked(chart);
  if (!figure || shapeOf(figure.chart) !== shapeOf(next)) return draw(element, chart);
  figure.chart = next;
  figure.panels.forEach((held, i) => {
    held.panel = next.panels[i];
    entitle(held);
    show(held);
  });
  if (figure.data.open) figure.data.dispatchEvent(new Event("toggle"));
  return undefined;
}

// The same panels, axes and labels: then only data differ.
function shapeOf(chart) {
  const panels = chart.panels.map(({ x, y, height, span, marks }) => [
    ...[x, y].map((axis) => [axis.label, axis.unit, axis.logarithmic, axis.categories]),
    height,
    span,
    marks.map((mark) => [mark.kind, mark.label, mark.colour]),
  ]);
  return JSON.stringify([chart.name, chart.columns, chart.linked, panels]);
}

// A document with the arrays where its marks name them.
function unpacked(chart) {
  const found = (mark, key) => (key in mark ? { [key]: chart.arrays[mark[key]] } : {});
  const whole = (mark) =>
    Object.assign({}, mark, ...["x", "y", "low", "high"].map((key) => found(mark, key)));
  const panels = chart.panels.map((panel) => ({ ...panel, marks: panel.marks.map(whole) }));
  return { ...chart, panels };
}

function forget(element) {
  const figure = figures.get(element);
  figure?.watch.disconnect();
  figure?.panels.forEach(({ plot }) => plot.destroy());
  figures.delete(element);
}

function fill(figure) {
  const { chart } = figure;
  figure.grid.style.setProperty("--columns", chart.columns);
  let column = 0;
  chart.panels.forEach((panel) => {
    if (column + panel.span > chart.columns) column = 0;
    const frame = make("div", "chart-panel", figure.grid);
    const head = make("div", "chart-head", frame);
    const title = make("div", "chart-title", head);
    const label = make("div", "chart-label", head);
    const reading = make("div", "chart-reading", head);
    const holder = make("div", "chart-plot", frame);
    const held = { figure, panel, column, frame, title, label, reading, holder, zoom: null };
    held.link = linkOf(held);
    entitle(held);
    figure.panels.push(held);
    column = (column + panel.span) % chart.columns;
  });
  for (const held of figure.panels) {
    held.plot = plotOf(held);
    reachable(held);
  }
  figure.legend.replaceChildren(...entriesOf(figure));
  fit(figure);
}

function entitle({ panel, title, label }) {
  title.textContent = panel.title;
  title.dataset.colour = panel.colour;
  label.textContent = withUnit(panel.y);
}

// Panels with the same link are zoomed together: all over time, wherever on the page they are.
function linkOf({ figure, panel, column }) {
  if (panel.x.unit === "s" && panel.x.label.startsWith("time")) return "time";
  const linked = figure.chart.linked && isSorted(panel);
  return `${figure.number} ${linked ? `column ${column}` : `panel ${figure.panels.length}`}`;
}

function linkedTo(held) {
  const every = [...figures.values()].flatMap((figure) => figure.panels);
  return every.filter((other) => other.link === held.link);
}

function plotOf(held) {
  const { panel, holder } = held;
  const scale = (axis) => ({
    time: false,
    auto: false,
    distr: panel[axis].logarithmic ? 3 : 1,
    dir: axis === "y" && panel.y.categories.length ? -1 : 1,
    range: () => rangesOf(held)[axis],
  });
  const options = {
    width: 300,
    height: 150,
    padding: [8, 14, 0, 0],
    legend: { show: false },
    scales: { x: scale("x"), y: scale("y") },
    series: [{}, { show: false }],
    axes: [axisOf(held, "x"), axisOf(held, "y")],
    cursor: {
      y: false,
      points: { show: false },
      drag: { x: true, y: !isSorted(panel), setScale: false, uni: 12 },
      sync: {
        key: held.link,
        scales: ["x", null],
        filters: { pub: (kind) => kind === "mousemove" || kind === "mouseleave" },
      },
      bind: { dblclick: () => () => zoomTo(held, null) },
    },
    hooks: {
      draw: [(plot) => drawMarks(plot, held.panel, held.figure.hidden)],
      setSelect: [(plot) => selected(held, plot)],
      setCursor: [(plot) => read(held, plot)],
    },
  };
  return new uPlot(options, [[0, 1], [0, 1]], holder);
}

function axisOf(held, axis) {
  const { panel, holder } = held;
  const { categories } = panel[axis];
  const font = "12px system-ui, sans-serif";
  const grid = { width: 1, stroke: () => shade(holder, "grid") };
  const made = {
    scale: axis,
    label: axis === "x" && isLowest(held) ? withUnit(panel.x) : undefined,
    labelSize: 20,
    labelFont: font,
    font,
    gap: 4,
    size: axis === "x" ? 26 : (_, values) => roomFor(values),
    space: axis === "x" ? 72 : 18,
    stroke: () => shade(holder, "text"),
    grid,
    ticks: { ...grid, size: 4 },
    filter: (_, splits) => splits,
    values: (_, values) => ticks(values),
  };
  if (panel[axis].logarithmic) {
    made.splits = (_plot, _axis, low, high) => decades(low, high);
    made.values = (_, values) => powersOfTen(values);
  }
  const { step } = panel[axis];
  if (step) made.splits = (_plot, _axis, low, high) => steps(low, high, step);
  if (categories.length) {
    made.splits = () => categories.map((_, i) => i);
    made.values = () => categories;
    if (axis === "y") made.size = 14 + 6.8 * Math.max(...categories.map((name) => name.length));
  }
  return made;
}

// The same for all panels, so that they stand below each other, but for very long numbers.
function roomFor(values) {
  return Math.max(56, ...(values ?? []).map((text) => 16 + 7 * text.length));
}

// Whether no panel below has the same axis, which then need not be named twice.
function isLowest(held) {
  const { chart, panels } = held.figure;
  if (!chart.linked || chart.columns > 1) return true; // on a telephone others stand between
  const below = panels[panels.indexOf(held) + 1];
  return !below || withUnit(below.panel.x) !== withUnit(held.panel.x);
}

function rangesOf({ panel, figure, zoom }) {
  const { hidden } = figure;
  if (!zoom) return { x: fullRange(panel, "x", hidden), y: fullRange(panel, "y", hidden) };
  return { x: zoom.x, y: zoom.y ?? rangeInSight(panel, hidden, zoom.x) };
}

function isZoomed(held) {
  return held.zoom !== null;
}

// Zoom a panel and those linked with it; null shows everything.
function zoomTo(held, zoom) {
  for (const other of linkedTo(held)) {
    other.zoom = zoom;
    show(other);
    other.figure.reset.hidden = !other.figure.panels.some(isZoomed);
  }
}

function show(held) {
  const { plot } = held;
  const ranges = rangesOf(held);
  plot.batch(() => {
    for (const axis of ["x", "y"]) {
      plot.setScale(axis, { min: ranges[axis][0], max: ranges[axis][1] });
    }
  });
  plot.redraw(false, true);
}

function selected(held, plot) {
  const { left, top, width, height } = plot.select;
  if (width < 4) return;
  const x = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
  const y = [plot.posToVal(top + height, "y"), plot.posToVal(top, "y")];
  plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  zoomTo(held, isSorted(held.panel) ? { x } : { x, y });
}

// Zoom by a factor about the middle, or move by a share of what is in sight.
function adjust(held, factor, share = 0) {
  const moved = (axis) => {
    const { logarithmic } = held.panel[axis];
    const [low, high] = rangesOf(held)[axis].map((end) => (logarithmic ? Math.log(end) : end));
    const middle = (low + high) / 2 + (axis === "x" ? share * (high - low) : 0);
    const ends = [middle - (factor * (high - low)) / 2, middle + (factor * (high - low)) / 2];
    return logarithmic ? ends.map(Math.exp) : ends;
  };
  zoomTo(held, isSorted(held.panel) ? { x: moved("x") } : { x: moved("x"), y: moved("y") });
}

const KEYS = {
  "+": (held) => adjust(held, 0.5),
  "=": (held) => adjust(held, 0.5),
  "-": (held) => adjust(held, 2),
  ArrowLeft: (held) => adjust(held, 1, -0.2),
  ArrowRight: (held) => adjust(held, 1, 0.2),
  0: (held) => zoomTo(held, null),
  Escape: (held) => zoomTo(held, null),
};

function reachable(held) {
  const { holder, panel, figure } = held;
  holder.tabIndex = 0;
  holder.setAttribute("role", "group");
  holder.setAttribute(
    "aria-label",
    `Plot: ${panel.title || figure.chart.title}. Plus and minus zoom, arrows move, 0 shows all.`,
  );
  holder.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in KEYS)) return;
    if (!isZoomed(held) && event.key === "Escape") return;
    event.preventDefault();
    KEYS[event.key](held);
  });
}

function buttonsOf(figure) {
  const group = make("div", "chart-buttons");
  const button = (text, label, act) => {
    const made = make("button", "", group);
    made.type = "button";
    made.textContent = text;
    made.setAttribute("aria-label", label);
    made.title = label;
    made.addEventListener("click", act);
    return made;
  };
  const once = (act) => () => {
    const links = new Map(figure.panels.map((held) => [held.link, held]));
    links.forEach(act);
  };
  figure.reset = button("Show all", "Show everything again", once((held) => zoomTo(held, null)));
  figure.reset.hidden = true;
  button("\u2212", "Zoom out", once((held) => adjust(held, 2)));
  button("+", "Zoom in", once((held) => adjust(held, 0.5)));
  return group;
}

// Labels of a figure, each once; a click hides what it names.
function entriesOf(figure) {
  const marks = figure.chart.panels.flatMap((panel) => panel.marks).filter((mark) => mark.label);
  const first = new Map([...marks].reverse().map((mark) => [mark.label, mark]));
  const labels = [...new Set(marks.map((mark) => mark.label))];
  return labels.map((label) => {
    const made = make("button", "chart-entry");
    made.type = "button";
    made.setAttribute("aria-pressed", "true");
    made.append(swatch(first.get(label)), label);
    made.addEventListener("click", () => {
      const hide = !figure.hidden.delete(label);
      if (hide) figure.hidden.add(label);
      made.setAttribute("aria-pressed", String(!hide));
      figure.panels.forEach(show);
    });
    return made;
  });
}

// A piece of the mark, so that shape and stroke tell it from others, and not colour alone.
function swatch(mark) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 12");
  svg.setAttribute("aria-hidden", "true");
  const shape = (tag, attributes) => {
    const made = document.createElementNS(svg.namespaceURI, tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.style.setProperty("--mark", `var(--chart-${mark.colour})`);
    svg.append(made);
  };
  if (mark.kind === "band" || mark.filled) {
    shape("rect", { x: 1, y: 1, width: 22, height: 10, class: "chart-area" });
  }
  if (mark.kind === "points") {
    shape("circle", { cx: 12, cy: 6, r: 3.2, class: "chart-dot", opacity: mark.faint ? 0.35 : 1 });
  }
  if (mark.kind === "line" || mark.kind === "level") {
    const width = mark.kind === "line" ? Math.min(mark.width * PIXELS, 4) : 1.4;
    const dashes = DASHES[mark.dash].join(" ");
    shape("line", { x1: 1, y1: 6, x2: 23, y2: 6, class: "chart-stroke", "stroke-width": width });
    if (dashes) svg.lastChild.setAttribute("stroke-dasharray", dashes);
  }
  return svg;
}

// The values under the pointer, beside the panel's title.
function read(held, plot) {
  const { left } = plot.cursor;
  const { panel, figure, reading } = held;
  const named = panel.x.categories.length || panel.y.categories.length;
  if (left === null || left === undefined || left < 0 || named || !isSorted(panel)) {
    reading.textContent = "";
    return;
  }
  const x = plot.posToVal(left, "x");
  const parts = [];
  for (const mark of panel.marks) {
    if (mark.kind === "level" || figure.hidden.has(mark.label) || !mark.x.length) continue;
    const i = nearest(mark.x, x);
    const label = mark.label ? `${mark.label} ` : "";
    if (mark.kind === "band") {
      if (mark.low[i] === null) continue;
      parts.push(`${label}${written4(mark.low[i])} to ${written4(mark.high[i])}`);
    } else if (mark.y[i] !== null) parts.push(`${label}${written4(mark.y[i])}`);
  }
  const unit = panel.y.unit ? ` ${panel.y.unit}` : "";
  const at = `${written4(x)}${panel.x.unit ? ` ${panel.x.unit}` : ""}`;
  reading.textContent = parts.length ? `${at}: ${[...new Set(parts)].join(" \u00b7 ")}${unit}` : "";
}

function written4(value) {
  return written(Number(value.toPrecision(4)));
}

function nearest(places, x) {
  let [low, high] = [0, places.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (places[middle] < x) low = middle;
    else high = middle;
  }
  return x - places[low] < places[high] - x ? low : high;
}

// Panels as wide as there is room; on paper as wide as paper.
const PAPER = 680;
let printing = false;

function fit(figure) {
  const wide = printing ? PAPER : figure.grid.clientWidth;
  if (!wide) return; // folded away
  if (wide === figure.wide) return;
  figure.wide = wide;
  const columns = !printing && wide < 560 ? 1 : figure.chart.columns;
  figure.grid.style.setProperty("--columns", columns);
  const column = (wide - 24 * (columns - 1)) / columns;
  const tallest = Math.max(...figure.chart.panels.map(({ height }) => height));
  const unit = Math.min(Math.max(column * 0.32, 170), 240) / tallest;
  for (const { plot, panel, frame } of figure.panels) {
    const span = Math.min(panel.span, columns);
    frame.style.gridColumn = `span ${span}`;
    const width = Math.floor(span * (column + 24) - 24);
    const lines = panel.y.categories.length;
    const height = lines ? 24 * lines + 60 : Math.round(Math.max(104, unit * panel.height));
    plot.setSize({ width, height });
  }
}

function redrawAll() {
  for (const figure of figures.values()) {
    fit(figure);
    figure.panels.forEach(({ plot }) => plot.redraw(false, true));
  }
}

function onPaper(begins) {
  printing = begins;
  document.documentElement.classList.toggle("printing", begins);
  redrawAll();
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawAll);
addEventListener("beforeprint", () => onPaper(true));
addEventListener("afterprint", () => onPaper(false));
