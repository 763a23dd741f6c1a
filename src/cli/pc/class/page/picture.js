// Paths and points of one or several bricks, seen from above.

const several = ["#0b66b5", "#b35000", "#7a3fc0", "#0b8a8f", "#8a6a00", "#a02a78"];
const dark = matchMedia("(prefers-color-scheme: dark)");
const light = ["#6cb8f5", "#f5a65b", "#c4a1f7", "#5fd0d4", "#dcc25a", "#f08fca"];
export const colour = (at) => (dark.matches ? light : several)[at % several.length];

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Pixels from metres: x to the right, y up, one scale for both. `tracks` are pictures with `pose`,
// `paint` and `name` where there are several; `least` is the least width that is shown, metres.
export function draw(canvas, tracks, least = 1) {
  const { width, height } = canvas.getBoundingClientRect();
  const dots = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * dots);
  canvas.height = Math.round(height * dots);
  const pen = canvas.getContext("2d");
  pen.setTransform(dots, 0, 0, dots, 0, 0);
  const low = [Infinity, Infinity];
  const high = [-Infinity, -Infinity];
  const include = (list) =>
    list.forEach((value, at) => {
      low[at % 2] = Math.min(low[at % 2], value);
      high[at % 2] = Math.max(high[at % 2], value);
    });
  for (const { path, points, ahead, pose } of tracks) {
    [path, points, ahead].forEach(include);
    if (pose) include([pose[0], pose[1]]);
  }
  if (low[0] > high[0]) include([0, 0]);
  const middle = [0, 1].map((axis) => (low[axis] + high[axis]) / 2);
  // A robot at the edge is seen whole, and its name.
  const edge = width > 200 ? 60 : 14;
  const scale = Math.min(
    (width - 2 * edge) / Math.max(least, high[0] - low[0]),
    (height - 2 * edge) / (high[1] - low[1]),
  );
  const px = (x, y) => [width / 2 + (x - middle[0]) * scale, height / 2 - (y - middle[1]) * scale];
  mesh(pen, px, { width, height, scale, middle });
  for (const track of tracks) trail(pen, px, track, width > 200);
  return {
    metres: (left, top) => [
      (left - width / 2) / scale + middle[0],
      (height / 2 - top) / scale + middle[1],
    ],
    px,
  };
}

// A line each metre, or each ten; with its number where there is room.
function mesh(pen, px, { width, height, scale, middle }) {
  const step = scale > 18 ? 1 : 10;
  pen.strokeStyle = css("--mesh");
  pen.lineWidth = 1;
  pen.beginPath();
  pen.fillStyle = css("--soft");
  pen.font = "11px system-ui, Ubuntu, sans-serif";
  const hasNumbers = width > 200 && scale * step > 40;
  const reach = Math.ceil(Math.max(width, height) / scale / step);
  for (let n = -reach; n <= reach; n++) {
    const [right, up] = middle.map((at) => (Math.round(at / step) + n) * step);
    const [x] = px(right, 0);
    const [, y] = px(0, up);
    pen.moveTo(x, 0);
    pen.lineTo(x, height);
    pen.moveTo(0, y);
    pen.lineTo(width, y);
    if (!hasNumbers) continue;
    if (x < width - 30) pen.fillText(`${right} m`, x + 3, height - 4);
    // The corner has one of the two.
    if (y < height - 20) pen.fillText(`${up} m`, 3, y - 3);
  }
  pen.stroke();
}

function trail(pen, px, { path, points, ahead, pose, paint, name }, isLarge) {
  pen.fillStyle = paint ?? css("--points");
  const edge = isLarge ? 3.4 : 2;
  for (let at = 0; at < points.length; at += 2) {
    const [left, top] = px(points[at], points[at + 1]);
    pen.fillRect(left - edge / 2, top - edge / 2, edge, edge);
  }
  pen.strokeStyle = paint ?? css("--path");
  pen.lineWidth = isLarge ? 2.2 : 1.5;
  pen.beginPath();
  const line = [...path, ...ahead];
  for (let at = 0; at < line.length; at += 2) {
    pen[at ? "lineTo" : "moveTo"](...px(line[at], line[at + 1]));
  }
  pen.stroke();
  if (!pose) return;
  const [x, y] = px(pose[0], pose[1]);
  const size = isLarge ? 1 : 0.6;
  pen.save();
  pen.translate(x, y);
  pen.rotate(-pose[2]);
  pen.beginPath();
  [
    [15, 0],
    [-10, 9],
    [-5, 0],
    [-10, -9],
  ].forEach(([ahead, left], at) => pen[at ? "lineTo" : "moveTo"](ahead * size, left * size));
  pen.closePath();
  pen.fillStyle = paint ?? css("--path");
  pen.fill();
  pen.restore();
  if (!name) return;
  pen.fillStyle = css("--ink");
  pen.font = "600 13px system-ui, Ubuntu, sans-serif";
  pen.fillText(name, x + 14, y - 12);
}
