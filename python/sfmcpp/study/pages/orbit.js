"use strict";
// A canvas on which points and lines are drawn in three dimensions: x right, y ahead, z up; the view turns about
// `view.target`. A page defines `draw()`, which begins with `prepare()`, and calls `redraw()` to have it called.
const element = id => document.getElementById(id);
const canvas = element("canvas"), ctx = canvas.getContext("2d", { alpha: false });
const BACKGROUND = [14, 19, 24], FIELD_OF_VIEW = 0.8;
const backdrop = (255 << 24) | (BACKGROUND[2] << 16) | (BACKGROUND[1] << 8) | BACKGROUND[0];
const view = { target: [0, 0, 0], distance: 1, yaw: 0, pitch: 0 };
let axes, width, height, focal, image, pixels, depths, scheduled = false, touchedAt = -1e9;

// Names of files break after their separators alone; where the panel would cover the scene it begins folded.
for (const heading of document.querySelectorAll("#about h1"))
  heading.innerHTML = heading.innerHTML.replace(/[-_.]/g, "$&<wbr>");
element("about").open = innerWidth > 600 && innerHeight > 500;

function bytesOf(text) {
  const binary = atob(text), bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}
const decoded = text => new Float32Array(bytesOf(text).buffer);
const mixed = (a, b, share) => a.map((value, i) => value + (b[i] - value) * share);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const row = (array, i) => [array[3 * i], array[3 * i + 1], array[3 * i + 2]];

function prepare() {
  scheduled = false;
  resize();
  turnAxes();
  showGauges();
}
function resize() {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const size = [Math.max(1, Math.round(innerWidth * ratio)), Math.max(1, Math.round(innerHeight * ratio))];
  if (size[0] !== width || size[1] !== height || !image) {
    [canvas.width, canvas.height] = [width, height] = size;
    image = ctx.createImageData(width, height);
    pixels = new Uint32Array(image.data.buffer);
    depths = new Float32Array(width * height);
  }
  focal = height / 2 / Math.tan(FIELD_OF_VIEW / 2);
}
function turnAxes() {
  const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
  const ahead = [-sy * cp, cy * cp, -sp], right = [cy, sy, 0], up = [-sy * sp, cy * sp, cp];
  axes = { ahead, right, up, eye: view.target.map((value, i) => value - view.distance * ahead[i]) };
}
function inCamera(x, y, z) {
  const from = [x - axes.eye[0], y - axes.eye[1], z - axes.eye[2]];
  return [dot(from, axes.right), dot(from, axes.up), dot(from, axes.ahead)];
}
const onScreen = p => [width / 2 + focal * p[0] / p[2], height / 2 - focal * p[1] / p[2]];
function redraw() {
  if (!scheduled) requestAnimationFrame(draw);
  scheduled = true;
}

// Points as squares, the nearest in front: every `stride`-th, coloured by `colorOf(i, depth)`, a pixel as one number.
function drawSquares(points, stride, colorOf, coarse = 1) {
  pixels.fill(backdrop);
  depths.fill(Infinity);
  const { right: [rx, ry, rz], up: [ux, uy, uz], ahead: [ax, ay, az], eye: [ex, ey, ez] } = axes;
  const near = 0.01 * view.distance, ratio = width / innerWidth, count = points.length / 3;
  for (let i = 0; i < count; i += stride) {
    const x = points[3 * i] - ex, y = points[3 * i + 1] - ey, z = points[3 * i + 2] - ez;
    const depth = x * ax + y * ay + z * az;
    if (depth < near) continue;
    const u = width / 2 + focal * (x * rx + y * ry + z * rz) / depth;
    const v = height / 2 - focal * (x * ux + y * uy + z * uz) / depth;
    const size = Math.max(1, Math.min(5, Math.round(ratio * coarse * (0.8 + 1.4 * view.distance / depth))));
    const left = Math.round(u - size / 2), top = Math.round(v - size / 2);
    if (left < 0 || top < 0 || left + size > width || top + size > height) continue;
    const color = colorOf(i, depth);
    for (let y = top; y < top + size; y++)
      for (let place = y * width + left; place < y * width + left + size; place++)
        if (depth < depths[place]) { depths[place] = depth; pixels[place] = color; }
  }
  ctx.putImageData(image, 0, 0);
}
// Add a line through `corners` to the path, as far as it is in front of the eye.
function line(corners) {
  const near = 0.01 * view.distance;
  for (let i = 0, before = null; i < corners.length; i++) {
    const here = inCamera(...corners[i]);
    if (before && (here[2] > near || before[2] > near)) {
      const [a, b] = [before, here].map((p, k, both) => p[2] > near ? p
        : mixed(p, both[1 - k], (near - p[2]) / (both[1 - k][2] - p[2])));
      if (i === 1 || a !== before) ctx.moveTo(...onScreen(a));
      ctx.lineTo(...onScreen(b));
    }
    before = here;
  }
}
function stroke(color, thickness, alpha, draw, dash = []) {
  ctx.beginPath();
  draw();
  ctx.strokeStyle = color;
  ctx.globalAlpha = alpha;
  ctx.lineJoin = "round";
  ctx.lineWidth = thickness * width / innerWidth;
  ctx.setLineDash(dash.map(length => length * width / innerWidth));
  ctx.stroke();
  ctx.globalAlpha = 1;
}

function turn(dx, dy) {
  view.yaw -= 0.006 * dx;
  view.pitch = Math.max(-1.57, Math.min(1.57, view.pitch + 0.006 * dy));
}
function move(dx, dy) {
  const step = view.distance / focal * width / innerWidth;
  view.target = view.target.map((value, i) => value + step * (dy * axes.up[i] - dx * axes.right[i]));
}
function touched() {
  touchedAt = performance.now();
  fitted = null;
  redraw();
}
const fingers = new Map();
let travelled = 0;
canvas.onpointerdown = event => {
  canvas.setPointerCapture(event.pointerId);
  if (!fingers.size) travelled = 0;
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
};
canvas.onpointerup = canvas.onpointercancel = event => {
  fingers.delete(event.pointerId);
  // A press that hardly moved is a click; pages may define what one does.
  if (event.type === "pointerup" && !fingers.size && travelled < 6 && typeof clicked === "function")
    clicked(event.clientX, event.clientY);
};
canvas.onpointermove = event => {
  const before = fingers.get(event.pointerId), here = [event.clientX, event.clientY];
  if (!before) return;
  const other = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place)[0];
  const [dx, dy] = [here[0] - before[0], here[1] - before[1]];
  travelled += Math.abs(dx) + Math.abs(dy);
  if (other) {
    const apart = p => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
    view.distance *= apart(before) / apart(here);
    move(dx / 2, dy / 2);
  } else if (event.shiftKey || event.buttons & 6) move(dx, dy);
  else turn(dx, dy);
  fingers.set(event.pointerId, here);
  touched();
};
canvas.oncontextmenu = event => event.preventDefault();
canvas.addEventListener("wheel", event => {
  event.preventDefault();
  view.distance *= Math.exp(0.001 * Math.max(-300, Math.min(300, event.deltaY * (event.deltaMode ? 30 : 1))));
  touched();
}, { passive: false });
canvas.ondblclick = event => {
  move(innerWidth / 2 - event.clientX, innerHeight / 2 - event.clientY);
  touched();
};
