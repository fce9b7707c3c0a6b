// Numbers as text, and the table behind a figure.

// Six digits are as many as the document has, where it says nothing else.
function written(value, digits = 6) {
  if (value === null || value === undefined) return "";
  return String(Number(value.toPrecision(digits)));
}

// The numbers at an axis: none longer than it has to be.
function ticks(values) {
  const largest = Math.max(...values.map(Math.abs));
  const usual = largest === 0 || (largest >= 1e-3 && largest < 1e5);
  const step = values.length > 1 ? Math.abs(values[1] - values[0]) : largest;
  const digits = Math.min(15, Math.max(6, 2 + Math.ceil(Math.log10(largest / step || 1))));
  return values.map((value) => {
    const text = usual || value === 0 ? written(value, digits) : value.toExponential().replace("e+", "e");
    return text.replaceAll("-", "\u2212");
  });
}

// The same at a logarithmic axis, where powers of ten stand.
function powersOfTen(values) {
  const far = values.some((value) => value < 1e-3 || value > 1e4);
  return values.map((value) => {
    const power = Math.round(Math.log10(value));
    const isPower = Math.abs(value / 10 ** power - 1) < 1e-9;
    if (!far || !isPower) return ticks([value])[0];
    return `10${[...String(power)].map((digit) => RAISED[digit]).join("")}`;
  });
}

const RAISED = Object.fromEntries([..."-0123456789"].map((c, i) => [c, "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"[i]]));

function withUnit({ label, unit }) {
  const raised = unit.replaceAll("^2", "²").replaceAll("^3", "³");
  return unit ? `${label} (${raised})`.trim() : label;
}

// Tables of a figure's panels, made when they are asked for.
function tablesOf(figure) {
  const details = make("details", "chart-data");
  make("summary", "", details).textContent = "The numbers of this figure";
  details.addEventListener("toggle", () => {
    details.querySelectorAll(".chart-table").forEach((old) => old.remove());
    if (details.open) details.append(...figure.panels.flatMap(({ panel }) => panelTables(panel)));
  });
  return details;
}

// One table for all marks over the same places.
function panelTables(panel) {
  const groups = new Map();
  for (const mark of panel.marks) {
    if (mark.kind === "level") continue;
    groups.set(mark.x, [...(groups.get(mark.x) ?? []), mark]);
  }
  const levels = panel.marks.filter((mark) => mark.kind === "level" && mark.label);
  const tables = [...groups].map(([x, marks]) => {
    const columns = [{ heading: withUnit(panel.x), values: names(panel.x, x) }];
    for (const mark of marks) {
      const label = mark.label || withUnit(panel.y);
      if (mark.kind === "band") {
        columns.push({ heading: `${label}, lower end`, values: mark.low });
        columns.push({ heading: `${label}, upper end`, values: mark.high });
      } else columns.push({ heading: label, values: names(panel.y, mark.y) });
    }
    return table(`${panel.title} (${withUnit(panel.y)})`, columns);
  });
  if (levels.length) {
    tables.push(
      table(`${panel.title}: lines across`, [
        { heading: "line", values: levels.map((level) => level.label) },
        { heading: "at", values: levels.map((level) => level.value) },
        { heading: "of", values: levels.map((level) => withUnit(panel[level.along])) },
      ]),
    );
  }
  return tables;
}

function names(axis, values) {
  return axis.categories.length ? values.map((value) => axis.categories[value] ?? value) : values;
}

function table(caption, columns) {
  const frame = make("div", "chart-table");
  frame.tabIndex = 0; // so that it can be scrolled with keys
  frame.setAttribute("role", "region");
  frame.setAttribute("aria-label", caption);
  const made = make("table", "", frame);
  make("caption", "", made).textContent = caption;
  const head = make("tr", "", make("thead", "", made));
  for (const { heading } of columns) {
    const cell = make("th", "", head);
    cell.scope = "col";
    cell.textContent = heading;
  }
  const body = make("tbody", "", made);
  for (let i = 0; i < columns[0].values.length; i++) {
    const row = make("tr", "", body);
    for (const { values } of columns) {
      const value = values[i];
      make("td", "", row).textContent = typeof value === "string" ? value : written(value);
    }
  }
  return frame;
}

function make(tag, name = "", parent = null) {
  const made = document.createElement(tag);
  if (name) made.className = name;
  parent?.append(made);
  return made;
}
