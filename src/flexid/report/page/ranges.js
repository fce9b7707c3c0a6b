// Ranges of axes: of all data, or of what a zoom leaves in sight.

// All values of a panel along an axis, with their places along x.
function* valuesAlong(panel, axis, hidden) {
  for (const mark of panel.marks) {
    if (hidden.has(mark.label)) continue;
    if (mark.kind === "level") {
      if (mark.along === axis) yield [[mark.value], null];
    } else if (axis === "x") yield [mark.x, mark.x];
    else if (mark.kind === "band") {
      yield [mark.low, mark.x];
      yield [mark.high, mark.x];
    } else yield [mark.y, mark.x];
  }
}

function extent(panel, axis, hidden, within = null) {
  const { logarithmic } = panel[axis];
  let [low, high] = [Infinity, -Infinity];
  for (const [values, places] of valuesAlong(panel, axis, hidden)) {
    for (let i = 0; i < values.length; i++) {
      const value = values[i];
      if (value === null || (logarithmic && value <= 0)) continue;
      if (within && places && (places[i] < within[0] || places[i] > within[1])) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low <= high ? [low, high] : null;
}

// The range of an axis with nothing zoomed.
function fullRange(panel, axis, hidden) {
  const described = panel[axis];
  if (described.categories.length) return [-0.5, described.categories.length - 0.5];
  if (described.limits) return described.limits;
  const found = extent(panel, axis, hidden) ?? extent(panel, axis, new Set());
  if (!found) return described.logarithmic ? [1, 10] : [0, 1];
  return widened(found, described.logarithmic, axis === "x" && isSorted(panel) ? 0 : 0.06);
}

// The range of y while x is zoomed: that of what is in sight.
function rangeInSight(panel, hidden, within) {
  const described = panel.y;
  if (described.categories.length) return fullRange(panel, "y", hidden);
  const found = extent(panel, "y", hidden, within);
  if (!found) return fullRange(panel, "y", hidden);
  const [low, high] = widened(found, described.logarithmic, 0.06);
  const [least, most] = described.limits ?? [-Infinity, Infinity];
  return low < most && high > least
    ? [Math.max(low, least), Math.min(high, most)]
    : described.limits;
}

function widened([low, high], logarithmic, share) {
  if (logarithmic) {
    const factor = high > low ? (high / low) ** share : 2;
    return [low / factor, high * factor];
  }
  const margin = high > low ? share * (high - low) : Math.abs(high) / 10 || 1;
  return [low - margin, high + margin];
}

// Whether all marks run from left to right: then a zoom is one of x alone.
function isSorted(panel) {
  panel.sorted ??= panel.marks.every(
    (mark) => mark.kind === "level" || mark.x.every((x, i) => i === 0 || mark.x[i - 1] <= x),
  );
  return panel.sorted;
}

// Numbers at a logarithmic axis: powers of ten, not too many, and others where there are few.
function decades(low, high) {
  const [first, last] = [Math.ceil(Math.log10(low)), Math.floor(Math.log10(high))];
  const step = Math.max(1, Math.ceil((last - first + 1) / 6));
  const powers = [];
  for (let power = first; power <= last; power++) {
    if (power % step === 0) powers.push(Number(`1e${power}`));
  }
  if (last - first >= 2) return powers;
  const between = [];
  for (let power = first - 1; power <= last; power++) {
    for (const digit of [1, 2, 5]) between.push(Number(`${digit}e${power}`));
  }
  const found = between.filter((value) => value >= low && value <= high);
  if (found.length > 1) return found;
  return [low, Math.sqrt(low * high), high].map((value) => Number(value.toPrecision(3)));
}

// Every step, or every second or third where there is no room for all.
function steps(low, high, step) {
  const [first, last] = [Math.ceil(low / step), Math.floor(high / step)];
  const stride = Math.max(1, Math.ceil((last - first) / 8));
  const found = [];
  for (let i = first; i <= last; i++) if (i % stride === 0) found.push(i * step);
  return found;
}
