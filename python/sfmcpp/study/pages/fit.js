// The nearest place of the eye, for a direction, from which all there is to see lies in the part of the window
// that no panel covers. Each side of that part is a plane through the eye; the scene must lie within all four.
// Of points, some may lie beyond each side: the few that are far off. A page has `points`, flat, and defines
// `placesToSee()`, all of which must be seen; what covers its lower end has the id "lower".
const FEW = 0.02, FAR = 1.5, MOST_FITTED = 20000, MARGIN = 14, LEAST_FREE = 60;
const quantile = (sorted, share) => sorted.length ? sorted[Math.round(share * (sorted.length - 1))] : 0;
const rows = (array, from = 0, to = array.length / 3) =>
  Array.from({ length: Math.max(to - from, 0) }, (_, i) => row(array, from + i));
let fitted = null;

// Look from a direction at all places, and at most of the points.
function look(yaw, pitch) {
  resize();
  Object.assign(view, { target: [0, 0, 0], distance: 0, yaw, pitch });
  turnAxes();
  const stride = Math.max(1, Math.ceil(points.length / 3 / MOST_FITTED)), most = [];
  for (let i = 0; i < points.length / 3; i += stride) most.push(inCamera(...row(points, i)));
  const all = placesToSee().map(place => inCamera(...place));
  const eyes = freeAreas().map(area => eyeThatSees(all, most, area));
  const [x, y, ahead] = eyes.reduce((one, other) => other[2] > one[2] ? other : one);
  view.distance = Math.max(-ahead, 0.2 * extentOf(all.length ? all : most)) || 1;
  view.target = [0, 1, 2].map(i => x * axes.right[i] + y * axes.up[i]);
  fitted = [yaw, pitch];
  redraw();
}
const extentOf = seen => Math.max(...[0, 1, 2].map(axis =>
  seen.reduce((most, place) => Math.max(most, Math.abs(place[axis])), 0)));

// Parts of the window beside and below the panel, and above the one at the bottom.
function freeAreas() {
  const about = element("about").getBoundingClientRect(), lower = element("lower");
  const bottom = (lower.offsetHeight ? lower.getBoundingClientRect().top : innerHeight) - MARGIN;
  const right = innerWidth - MARGIN;
  const areas = [[about.right, 0], [0, about.bottom]].map(([x, y]) => ({ left: x + MARGIN, top: y + MARGIN, right, bottom }));
  const large = areas.filter(({ left, top }) => right - left > LEAST_FREE && bottom - top > LEAST_FREE);
  return large.length ? large : [{ left: 0, top: 0, right: innerWidth, bottom: innerHeight }];
}

// The eye, to the right, up and ahead of the origin, for places given in these axes.
function eyeThatSees(all, most, area) {
  const scale = focal * innerWidth / width;
  const slopes = [area.right - innerWidth / 2, innerWidth / 2 - area.left, innerHeight / 2 - area.top, area.bottom - innerHeight / 2];
  // How far places lie beyond the plane of each side through the origin.
  const [right, left, up, down] = slopes.map((pixels, side) => {
    const axis = side >> 1, sign = side % 2 ? -1 : 1;
    const beyond = place => sign * place[axis] - pixels / scale * place[2];
    const sorted = Float64Array.from(most, beyond).sort();
    return { slope: pixels / scale, least: all.reduce((least, place) => Math.max(least, beyond(place)), endOf(sorted)) };
  });
  const along = [[right, left], [up, down]];
  const ahead = Math.min(...along.map(([a, b]) => -(a.least + b.least) / (a.slope + b.slope)));
  const [x, y] = along.map(([a, b]) => (a.least + a.slope * ahead - b.least - b.slope * ahead) / 2);
  return [x, y, ahead].map(value => Number.isFinite(value) ? value : 0);
}
// The largest of the values that is not far off: no farther from the middle than most are, and half of that.
function endOf(sorted) {
  const middle = quantile(sorted, 0.5), far = middle + FAR * (quantile(sorted, 1 - FEW) - middle);
  return sorted.findLast(value => value <= far) ?? -Infinity;
}
// A window that is turned or resized shows all of it again, as long as nobody has moved the view.
addEventListener("resize", () => fitted ? look(...fitted) : redraw());
