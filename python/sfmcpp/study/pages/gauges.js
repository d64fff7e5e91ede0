// Gauges of a view: how long some metres are in the plane through what is looked at, and where north is, as far
// as the scene tells (`scene.unit`, empty for an unknown scale, and `scene.north`, null where nobody knows).
const LONGEST_BAR = innerWidth > 600 ? 120 : 90, NEEDLE = 20;
document.body.insertAdjacentHTML("beforeend", `<style>
  #gauges { position: fixed; left: 16px; bottom: 16px; pointer-events: none; color: #d7dde3; text-shadow: 0 0 3px #0e1318, 0 0 3px #0e1318; }
  #gauges [hidden] { display: none; }
  #compass { display: block; width: 64px; height: 64px; overflow: visible; }
  #compass ellipse { fill: none; stroke: #8d99a5; } #compass text { fill: #d7dde3; font-size: 12px; text-anchor: middle; dominant-baseline: central; }
  #bar { box-sizing: border-box; margin-top: 4px; height: 5px; border: solid #d7dde3; border-width: 0 1.5px 1.5px; }
  @media (max-width: 1000px) { #gauges { bottom: 108px; } }
  @media (max-width: 600px), (max-height: 600px) { #gauges { left: auto; bottom: auto; right: 16px; top: 16px; display: flex; flex-direction: column; align-items: flex-end; } }
</style>
<div id="gauges">
  <svg id="compass" viewBox="-32 -32 64 64" role="img" aria-label="north" hidden><ellipse rx="${NEEDLE}"/>
    <line stroke="#8d99a5" stroke-width="2"/><line stroke="#ff7a59" stroke-width="3"/><text>N</text></svg>
  <div id="scale" title="in the plane through the middle of the view" hidden><span></span><div id="bar"></div></div>
</div>`);
if (matchMedia("(pointer: coarse)").matches)
  element("gestures").textContent = "drag: turn · two fingers: move and zoom";

function showGauges() {
  element("scale").hidden = !scene.unit;
  if (scene.unit) showScale(focal / view.distance * innerWidth / width);
  element("compass").toggleAttribute("hidden", !scene.north);
  if (scene.north) showNorth(dot(scene.north, axes.right), -dot(scene.north, axes.up), Math.abs(Math.sin(view.pitch)));
}
function showScale(pixelsOfUnit) {
  const longest = LONGEST_BAR / pixelsOfUnit, decade = 10 ** Math.floor(Math.log10(longest));
  const length = +([5, 2, 1].find(step => step * decade <= longest) * decade).toPrecision(1);
  element("bar").style.width = `${length * pixelsOfUnit}px`;
  const inKilometres = scene.unit === "m" && length >= 1000;
  element("scale").firstChild.textContent = inKilometres ? `${length / 1000} km` : `${length} ${scene.unit}`;
}
// x to the right and y down, of a needle of length one; the ring lies level.
function showNorth(x, y, flatness) {
  const [ring, tail, tip, letter] = element("compass").children;
  ring.setAttribute("ry", NEEDLE * flatness);
  for (const [half, sign] of [[tail, -1], [tip, 1]])
    for (const [name, value] of Object.entries({ x1: 0, y1: 0, x2: sign * NEEDLE * x, y2: sign * NEEDLE * y }))
      half.setAttribute(name, value);
  const far = 1 + 9 / Math.max(NEEDLE * Math.hypot(x, y), 9);
  letter.setAttribute("x", NEEDLE * x * far);
  letter.setAttribute("y", NEEDLE * y * far);
}
