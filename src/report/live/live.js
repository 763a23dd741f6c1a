"use strict";
const byId = (id) => document.getElementById(id);
const canvas = byId("room"),
  pen = canvas.getContext("2d");
const most = 50000;
const empty = () => ({
  room: null,
  marks: [],
  path: [],
  points: [],
  map: null,
  history: {},
  grown: 0,
  low: [Infinity, Infinity],
  high: [-Infinity, -Infinity],
  first: null,
});
let kept = empty(); // what has gathered of this session
let news = null; // the last answer
let since = "";
let css = {};

// Colours of the style sheet, which follow the system's light and dark.
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of [
    "paper",
    "ink",
    "soft",
    "mesh",
    "label",
    "wall",
    "block",
    "floor",
    "edge",
    "truth",
    "belief",
    "beam",
    "bad",
  ])
    css[name] = style.getPropertyValue(`--${name}`).trim();
}
readColours();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  readColours();
  draw();
});

// Several robots have a colour each; a single one that of the truth.
const several = ["#0b66b5", "#7a3fc0", "#0b8a8f", "#a02a78", "#8a6a00", "#b35000"];
const colour = (robot) =>
  news.sim.robots.length > 1 ? several[robot % several.length] : css.truth;
const alpha = (hex, part) =>
  `${hex}${Math.round(part * 255)
    .toString(16)
    .padStart(2, "0")}`;

// Pixels from metres: x to the right, y up, one scale for both.
const view = { scale: 1, x: 0, y: 0, moved: false };
const px = ([x, y]) => [view.x + x * view.scale, view.y - y * view.scale];
const metres = ([left, top]) => [(left - view.x) / view.scale, (view.y - top) / view.scale];

function include([x, y], margin = 0.1) {
  kept.low = [Math.min(kept.low[0], x - margin), Math.min(kept.low[1], y - margin)];
  kept.high = [Math.max(kept.high[0], x + margin), Math.max(kept.high[1], y + margin)];
}

function size() {
  const { width, height } = canvas.getBoundingClientRect(),
    dots = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * dots) || canvas.height !== Math.round(height * dots)) {
    canvas.width = Math.round(width * dots);
    canvas.height = Math.round(height * dots);
  }
  pen.setTransform(dots, 0, 0, dots, 0, 0);
  return { width, height };
}

function fit({ width, height }) {
  const known = kept.low[0] < kept.high[0];
  const [low, high] = known
    ? [kept.low, kept.high]
    : [
        [-0.5, -0.5],
        [0.5, 0.5],
      ];
  const span = [0, 1].map((axis) => Math.max(0.6, high[axis] - low[axis]));
  // Left and below is room for the numbers, above for the legend.
  view.scale = Math.max(1, Math.min((width - 60) / span[0], (height - 66) / span[1]));
  view.x = (width + 34 - view.scale * (low[0] + high[0])) / 2;
  view.y = (height + 14 + view.scale * (low[1] + high[1])) / 2;
}

function line(points, closed) {
  pen.beginPath();
  points.forEach((point, index) => pen[index ? "lineTo" : "moveTo"](...px(point)));
  if (closed) pen.closePath();
}

function mesh(width, height) {
  const ten = 10 ** Math.floor(Math.log10(64 / view.scale));
  const step = [1, 2, 5, 10].map((times) => times * ten).find((step) => step * view.scale >= 64);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const label = (value) => `${(value + 0).toFixed(decimals).replace(/^-(0\.?0*)$/, "$1")} m`;
  pen.lineWidth = 1;
  pen.strokeStyle = css.mesh;
  pen.fillStyle = css.label;
  pen.font = "12px system-ui, Ubuntu, sans-serif";
  for (let n = Math.ceil(-view.x / view.scale / step); px([n * step, 0])[0] < width; n++) {
    const [x] = px([n * step, 0]);
    pen.beginPath();
    pen.moveTo(x, 0);
    pen.lineTo(x, height);
    pen.stroke();
    if (x > 54 && x < width - 20) {
      pen.textAlign = "center";
      pen.fillText(label(n * step), x, height - 7);
    }
  }
  for (let n = Math.ceil((view.y - height) / view.scale / step); px([0, n * step])[1] > 0; n++) {
    const [, y] = px([0, n * step]);
    pen.beginPath();
    pen.moveTo(0, y);
    pen.lineTo(width, y);
    pen.stroke();
    if (y > (innerWidth > 720 ? 50 : 12) && y < height - 22) {
      pen.textAlign = "left";
      pen.fillText(label(n * step), 7, y - 3);
    }
  }
}

function floor() {
  const { room } = kept;
  if (!room || !room.floor.length) return;
  // Marks are seen on a floor of their own, in the dark as well.
  if (room.floor.every((paint) => paint.width_m !== null)) {
    const [low, high] = [room.low, room.high];
    line([low, [high[0], low[1]], high, [low[0], high[1]]], true);
    pen.fillStyle = css.floor;
    pen.fill();
  }
  pen.lineJoin = "round";
  for (const paint of room.floor) {
    line(paint.points, paint.closed || paint.width_m === null);
    if (paint.width_m === null) {
      pen.fillStyle = paint.colour;
      pen.fill();
      pen.strokeStyle = css.edge;
      pen.lineWidth = 1;
    } else {
      pen.strokeStyle = paint.colour;
      pen.lineWidth = paint.width_m * view.scale;
    }
    pen.stroke();
  }
}

function around(shape, [x, y]) {
  let inside = false;
  shape.slice(1).forEach(([toX, toY], index) => {
    const [fromX, fromY] = shape[index];
    if (fromY > y !== toY > y && x < fromX + ((toX - fromX) * (y - fromY)) / (toY - fromY))
      inside = !inside;
  });
  return inside;
}

function walls() {
  const start = kept.first
    ? [kept.first.x_m, kept.first.y_m]
    : kept.path.length
      ? kept.path
      : [Infinity, Infinity];
  pen.lineJoin = pen.lineCap = "round";
  for (const wall of kept.room?.walls ?? []) {
    const last = wall[wall.length - 1],
      closed = wall.length > 2 && wall[0][0] === last[0] && wall[0][1] === last[1];
    line(wall, closed);
    // One that stands around the robot is the room's own, and no block.
    if (closed && !around(wall, start)) {
      pen.fillStyle = css.block;
      pen.fill();
    }
    pen.strokeStyle = css.wall;
    pen.lineWidth = 2.5;
    pen.stroke();
  }
  return kept.room?.walls.length ?? 0;
}

function dots(list, paint, edge) {
  pen.fillStyle = paint;
  for (let at = 0; at < list.length; at += 2) {
    const [left, top] = px([list[at], list[at + 1]]);
    pen.fillRect(left - edge / 2, top - edge / 2, edge, edge);
  }
}

// True paths, and where there is no map of the robot's own, what its sensor said and where it truly
// was then.
function trails() {
  let echoes = 0;
  const paths = news.sim.robots.map(() => new Path2D()),
    begun = [];
  for (const [robot, echo, x, y] of kept.marks) {
    const [left, top] = px([x, y]);
    if (echo) {
      echoes++;
      if (news.run) continue;
      pen.fillStyle = alpha(css.belief, 0.7);
      pen.fillRect(left - 1.7, top - 1.7, 3.4, 3.4);
    } else if (paths[robot]) {
      paths[robot][begun[robot] ? "lineTo" : "moveTo"](left, top);
      begun[robot] = true;
    }
  }
  pen.lineWidth = 2.2;
  paths.forEach((path, robot) => {
    pen.strokeStyle = colour(robot);
    pen.stroke(path);
  });
  return echoes;
}

function believed() {
  const { path } = kept,
    status = news.run?.status;
  const list = [];
  for (let at = 0; at < path.length; at += 2) list.push([path[at], path[at + 1]]);
  const ahead = news.run?.ahead ?? [];
  for (let at = 0; at < ahead.length; at += 2) list.push([ahead[at], ahead[at + 1]]);
  if (status) list.push([status.x_m, status.y_m]);
  line(list, false);
  pen.strokeStyle = css.belief;
  pen.lineWidth = 2.2;
  pen.setLineDash(news.sim ? [6, 5] : []);
  pen.stroke();
  pen.setLineDash([]);
}

function arrow(status) {
  const [x, y] = px([status.x_m, status.y_m]),
    turn = (-status.heading_deg * Math.PI) / 180;
  pen.save();
  pen.translate(x, y);
  pen.rotate(turn);
  pen.beginPath();
  const unit = Math.min(15, Math.max(8, 0.07 * view.scale)) / 15;
  for (const [index, [ahead, left]] of [
    [15, 0],
    [-10, 9],
    [-5, 0],
    [-10, -9],
  ].entries())
    pen[index ? "lineTo" : "moveTo"](ahead * unit, left * unit);
  pen.closePath();
  pen.fillStyle = css.belief;
  pen.strokeStyle = css.paper;
  pen.lineWidth = 1.8;
  pen.fill();
  pen.stroke();
  pen.restore();
}

function beam({ from, axis_deg, half_deg, echo_m }) {
  const [x, y] = px(from),
    angle = (degrees) => (-degrees * Math.PI) / 180;
  pen.beginPath();
  pen.moveTo(x, y);
  pen.arc(x, y, (echo_m ?? 1) * view.scale, angle(axis_deg + half_deg), angle(axis_deg - half_deg));
  pen.closePath();
  pen.fillStyle = alpha(css.beam, echo_m === null ? 0.09 : 0.26);
  pen.fill();
  if (echo_m === null) return;
  pen.beginPath();
  pen.arc(x, y, echo_m * view.scale, angle(axis_deg + half_deg), angle(axis_deg - half_deg));
  pen.strokeStyle = css.beam;
  pen.lineWidth = 2.5;
  pen.stroke();
}

// A place before a robot's middle, and to its left.
function at(robot, ahead, left) {
  const turn = (robot.heading_deg * Math.PI) / 180;
  return [
    robot.x_m + Math.cos(turn) * ahead - Math.sin(turn) * left,
    robot.y_m + Math.sin(turn) * ahead + Math.cos(turn) * left,
  ];
}

function body(robot, number) {
  line(robot.outline, true);
  pen.fillStyle = colour(number);
  pen.fill();
  pen.strokeStyle = robot.faults.length ? css.bad : css.paper;
  pen.lineWidth = robot.faults.length ? 3 : 1.5;
  pen.stroke();
  line([at(robot, 0.015, 0.04), at(robot, 0.065, 0), at(robot, 0.015, -0.04)], false);
  pen.strokeStyle = css.paper;
  pen.lineWidth = Math.max(2, 0.014 * view.scale);
  pen.stroke();
  if (robot.beam) {
    // The head, and where it looks.
    const look = (robot.beam.axis_deg * Math.PI) / 180,
      [x, y] = robot.beam.from;
    line(
      [
        [x, y],
        [x + Math.cos(look) * 0.05, y + Math.sin(look) * 0.05],
      ],
      false,
    );
    pen.strokeStyle = css.ink;
    pen.lineWidth = Math.max(2, 0.012 * view.scale);
    pen.stroke();
  }
  if (news.sim.robots.length > 1) {
    pen.fillStyle = css.ink;
    pen.font = "600 13px system-ui, Ubuntu, sans-serif";
    pen.textAlign = "center";
    const [x, y] = px([robot.x_m, robot.y_m]);
    pen.fillText(String(number + 1), x, y - 0.14 * view.scale);
  }
}

// A robot in a person's hand: where it would be put down, and the knob that turns it.
const knobAhead = () => 0.12 + 22 / view.scale;
function inHand() {
  const robot = hand?.moves && hand.pose;
  const shown = robot || (hovered !== null && can("order") && news.sim?.robots[hovered]);
  if (!shown) return;
  if (robot) {
    line(
      [
        at(robot, 0.1, 0.08),
        at(robot, 0.1, -0.08),
        at(robot, -0.08, -0.08),
        at(robot, -0.08, 0.08),
      ],
      true,
    );
    pen.strokeStyle = css.ink;
    pen.lineWidth = 2;
    pen.setLineDash([5, 4]);
    pen.stroke();
    pen.setLineDash([]);
  }
  const knob = px(at(shown, knobAhead(), 0));
  line([[shown.x_m, shown.y_m], metres(knob)], false);
  pen.strokeStyle = css.ink;
  pen.lineWidth = 1.3;
  pen.stroke();
  pen.beginPath();
  pen.arc(...knob, 8, 0, 2 * Math.PI);
  pen.fillStyle = css.paper;
  pen.fill();
  pen.lineWidth = 2;
  pen.stroke();
}

let first_s = null;
function draw() {
  if (!news) return;
  const { width, height } = size();
  const [one] = news.sim?.robots ?? [];
  kept.first ??= one ?? null;
  if (!view.moved) fit({ width, height });
  pen.clearRect(0, 0, width, height);
  mesh(width, height);
  floor();
  if (kept.map)
    dots(kept.map.places, alpha(css.belief, 0.22), Math.max(2, kept.map.cell_m * view.scale));
  const drawn = walls();
  dots(kept.points, alpha(css.belief, 0.8), 3.4);
  const robots = news.sim?.robots ?? [],
    status = news.run?.status;
  const echoes = news.sim ? trails() : 0;
  if (news.run) believed();
  robots.forEach((robot) => robot.beam && beam(robot.beam));
  robots.forEach(body);
  if (status) arrow(status);
  inHand();
  const time_s = time();
  const data = {
    time: time_s.toFixed(3),
    walls: drawn,
    echoes,
    robots: robots.length,
    session: news.session,
    faults: robots.flatMap((robot) => robot.faults).join(", "),
    points: kept.points.length / 2,
    path: kept.path.length / 2,
    grown: kept.grown,
    phase: news.run?.phase ?? "",
    pace: news.pace ?? "",
    believedX: status ? status.x_m.toFixed(4) : "",
    believedY: status ? status.y_m.toFixed(4) : "",
  };
  if (one) {
    first_s ??= time_s;
    Object.assign(data, {
      x: one.x_m.toFixed(4),
      y: one.y_m.toFixed(4),
      heading: one.heading_deg.toFixed(2),
      moved: (one.travelled_m - kept.first.travelled_m).toFixed(4),
      waited: (time_s - first_s).toFixed(3),
    });
  }
  Object.assign(canvas.dataset, data);
}

const time = () => news.run?.status?.elapsed_s ?? (news.run ? 0 : (news.sim?.time_s ?? 0));
const can = (what) => news?.can.includes(what) ?? false;

const element = (name, text, kind) => {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
};
const put = (parent, ...children) => {
  parent.append(...children.filter(Boolean));
  return parent;
};
// Fills a part of the page again only where what it shows has changed: a person may be reading it.
const last = new Map();
function fill(place, shows, make) {
  const key = JSON.stringify(shows);
  if (last.get(place) === key) return;
  last.set(place, key);
  place.replaceChildren(...(shows === null ? [] : make().filter(Boolean)));
}
const title = (text, aside, chip) => {
  const made = element("h2");
  if (chip) {
    const box = element("i");
    box.style.background = chip;
    made.append(box);
  }
  made.append(text);
  if (aside) made.append(aside);
  return made;
};
const number = (value) =>
  Number.isInteger(value) ? String(value) : Number(value.toPrecision(4)).toString();
const seconds = (value) =>
  value < 60
    ? `${value.toFixed(1)} s`
    : `${Math.floor(value / 60)} min ${Math.floor(value % 60)} s`;

// A condition without the brackets that stand around a number and around all of it.
function plain(why) {
  const text = why.replace(/\((-?[\d.]+)\)/g, "$1"),
    inner = text.slice(1, -1);
  let depth = 0;
  const whole =
    text.startsWith("(") &&
    text.endsWith(")") &&
    [...inner].every((letter) => (depth += letter === "(" ? 1 : letter === ")" ? -1 : 0) >= 0);
  return whole ? inner : text;
}

function mission() {
  const { run } = news,
    status = run?.status,
    place = byId("mission");
  if (!status) return fill(place, null);
  const machines = status.states.map(([name, state]) => ({
    name,
    state,
    entered: kept.history[name] ?? [],
  }));
  const since = machines.map(({ state, entered }) =>
    entered.length && entered[0].to === state
      ? Math.max(0, status.elapsed_s - entered[0].time_s)
      : null,
  );
  fill(
    place,
    [
      machines.map(({ name, state, entered }) => [name, state, entered.length]),
      since.map((s) => (s === null ? 0 : Math.floor(s))),
      status.said,
      status.warning,
    ],
    () => [
      title("Mission"),
      ...status.said.map((text) => element("p", text, "said")),
      ...machines.map(({ name, state, entered }, index) =>
        put(
          element("div", undefined, "machine"),
          element("p", state, "state"),
          element(
            "p",
            [
              machines.length > 1 ? name : null,
              since[index] === null || since[index] < 1
                ? null
                : `for ${seconds(Math.floor(since[index])).replace(".0", "")}`,
            ]
              .filter(Boolean)
              .join(", ") || name,
            "soft",
          ),
          entered.length &&
            put(
              element("ul", undefined, "history"),
              ...entered
                .slice(0, 60)
                .map((one) =>
                  put(
                    element("li"),
                    element("time", seconds(one.time_s)),
                    element("b", one.to),
                    element("span", plain(one.why)),
                  ),
                ),
            ),
        ),
      ),
      status.warning && element("p", status.warning, "bad"),
    ],
  );
}

function variables() {
  const list = news.run?.status?.variables ?? [];
  fill(byId("variables"), list.length ? list : null, () => [
    title("Variables"),
    put(
      element("table"),
      ...list.map(([name, value]) =>
        put(element("tr"), element("td", name), element("td", number(value))),
      ),
    ),
  ]);
}

function level(volts) {
  const bar = element("div", undefined, "bar"),
    level = element("b");
  // Six cells: empty at 5 V, full at 9 V.
  level.style.width = `${Math.min(100, Math.max(2, (volts - 5) * 25))}%`;
  level.style.background = volts < 5.8 ? "var(--bad)" : volts < 6.5 ? "var(--beam)" : "var(--good)";
  bar.append(level);
  return bar;
}
// No zero has a sign.
const fixed = (value, decimals) => value.toFixed(decimals).replace(/^-(0\.?0*)$/, "$1");
const pose = (one) =>
  `x ${fixed(one.x_m, 2)} m, y ${fixed(one.y_m, 2)} m, ${fixed(one.heading_deg, 0)}°`;
const volts = (value) =>
  value === null || value === undefined
    ? null
    : element("span", `${value.toFixed(2)} V`, value < 5.8 ? "bad" : "");

function robots() {
  const { sim, run } = news,
    status = run?.status,
    place = byId("robots");
  if (!sim) {
    return fill(
      place,
      status
        ? [pose(status), status.travelled_m.toFixed(2), status.points, status.battery_v, run.senses]
        : null,
      () => [
        put(
          element("section"),
          title(run.brick || "Robot", volts(status.battery_v), css.belief),
          status.battery_v && level(status.battery_v),
          element("p", pose(status)),
          element(
            "p",
            `${status.travelled_m.toFixed(2)} m driven, ${status.points} points`,
            "soft",
          ),
          run.senses &&
            put(
              element("table"),
              ...run.senses.map(([what, name, value]) =>
                put(
                  element("tr"),
                  element("td", name),
                  element("td", what, "soft"),
                  element("td", number(value)),
                ),
              ),
            ),
        ),
      ],
    );
  }
  fill(place, [sim.robots, status], () =>
    sim.robots.map((robot, at) => {
      const section = element("section");
      put(
        section,
        title(
          sim.robots.length > 1 ? `Robot ${at + 1}` : "Robot",
          volts(robot.battery_v),
          colour(at),
        ),
        level(robot.battery_v),
      );
      put(section, element("p", pose(robot)));
      put(
        section,
        element(
          "p",
          `${fixed(robot.speed_mps * 100, 0)} cm/s, ${robot.travelled_m.toFixed(2)} m driven, ` +
            `head ${fixed(robot.head_deg, 0)}°`,
          "soft",
        ),
      );
      if (status) {
        const off = Math.hypot(status.x_m - robot.x_m, status.y_m - robot.y_m) * 100;
        put(
          section,
          put(element("p", `believes ${pose(status)}`)),
          element("p", `${off.toFixed(1)} cm off, ${status.points} points`, "soft"),
        );
        section.querySelectorAll("p")[2].style.color = "var(--belief)";
      }
      const wrong = [
        robot.touching && "touching something",
        robot.fallen && "fallen off the edge",
      ].filter(Boolean);
      if (wrong.length) put(section, element("p", wrong.join(", "), "bad"));
      for (const fault of robot.faults) put(section, element("p", `fault: ${fault}`, "bad"));
      const table = element("table");
      for (const device of robot.devices) {
        const bad = robot.faults.some((fault) => fault.startsWith(`${device.port} `)) ? "bad" : "";
        const row = put(
          element("tr"),
          element("td", device.port, bad),
          element("td", device.what, "soft"),
          element("td", device.told, bad),
        );
        row.title = `${device.name}, ${device.driver}: ${device.state} ${device.value}`;
        table.append(row);
      }
      return put(section, table);
    }),
  );
}

// The brick: screen, lights, tone, and its buttons as they lie on it, each down for as long as it
// is held here.
const layout = ["back", "up", null, "left", "enter", "right", null, "down", null];
const post = async (path, text) => {
  try {
    const answer = await fetch(path, { method: "POST", headers: { "X-Onbrick": "1" }, body: text });
    if (!answer.ok) tell((await answer.text()).trim());
  } catch (error) {
    console.warn(error);
  }
};
const order = (text) => post("order", text);
let held = null;
function letGo() {
  if (held) order(`robot ${held.robot + 1} release ${held.name}`);
  held = null;
}
window.addEventListener("pointerup", letGo);
window.addEventListener("pointercancel", letGo);
window.addEventListener("blur", letGo);

let quiet = null;
function tell(text) {
  const told = byId("told");
  told.textContent = text;
  told.classList.add("shown");
  clearTimeout(quiet);
  quiet = setTimeout(() => told.classList.remove("shown"), 3500);
}

function keys(robot) {
  const grid = element("div", undefined, "keys");
  for (const name of layout) {
    const key = element(name ? "button" : "span", name ?? "");
    if (name) {
      key.type = "button";
      key.dataset.button = name;
      const press = () => {
        letGo();
        held = { robot, name };
        order(`robot ${robot + 1} press ${name} for 60`);
      };
      key.addEventListener("pointerdown", press);
      key.addEventListener("keydown", (event) => event.key === " " && !event.repeat && press());
      key.addEventListener("keyup", (event) => event.key === " " && letGo());
      key.addEventListener("contextmenu", (event) => event.preventDefault());
    }
    grid.append(key);
  }
  return grid;
}

const shine = ({ red, green }) =>
  red + green < 8
    ? "transparent"
    : red > 8
      ? `rgb(${Math.min(255, red)} ${Math.min(255, green * 0.62)} 20)`
      : `rgb(${Math.min(255, red)} ${Math.min(255, green * 0.85)} 60)`;
const lit = ({ red, green }) =>
  red + green < 8 ? "off" : red > 8 && green > 8 ? "amber" : red > 8 ? "red" : "green";
function bricks() {
  const all = news.sim?.robots ?? [],
    place = byId("bricks");
  fill(place, all.length ? [news.session, all.length] : null, () =>
    all.map((_, robot) => {
      const section = put(
        element("section"),
        title(all.length > 1 ? `Brick ${robot + 1}` : "Brick"),
      );
      const face = element("div", undefined, "brick"),
        screen = element("img");
      screen.alt = "The brick's screen";
      const lights = put(element("div", undefined, "lights"), element("i"), element("i"));
      const tone = element("div", "silent", "tone");
      return put(
        section,
        put(face, screen, put(element("div", undefined, "signs"), lights, tone)),
        keys(robot),
      );
    }),
  );
  [...place.children].forEach((section, robot) => {
    const { pressed, lights, tone_hz, screen } = all[robot];
    section.querySelectorAll("button").forEach((key) => {
      key.classList.toggle("down", pressed.includes(key.dataset.button));
      key.disabled = !can("order");
    });
    const image = section.querySelector("img"),
      address = `screen?robot=${robot}&drawn=${news.session}.${screen}`;
    image.hidden = !screen;
    if (screen && image.getAttribute("src") !== address) image.src = address;
    section.querySelectorAll(".lights i").forEach((light, side) => {
      light.style.background = shine(lights[side]);
      light.title = `${side ? "right" : "left"} light: ${lit(lights[side])}`;
    });
    section.dataset.lights = lights.map(lit).join(" ");
    const tone = section.querySelector(".tone");
    tone.textContent = tone_hz ? `♪ ${tone_hz} Hz` : "silent";
    tone.classList.toggle("sounds", Boolean(tone_hz));
  });
}

function done() {
  const list = news.sim?.done ?? [];
  fill(byId("done"), list.length ? list : null, () => [
    title("Done by hand or on purpose"),
    put(
      element("ul", undefined, "plain"),
      ...[...list].reverse().map((what) => element("li", what)),
    ),
  ]);
}

const words = {
  preparing: "getting ready",
  driving: "running",
  ended: "ended",
  failed: "failed",
  refused: "did not start",
};
function head() {
  document.title = `${news.title} · onbrick`;
  document.querySelector("h1").textContent = news.title;
  const phase = byId("phase"),
    is = lost ? "lost" : (news.run?.phase ?? "");
  phase.hidden = !is;
  phase.className = is;
  phase.textContent = lost
    ? "no answer: the command that shows this page has ended"
    : (words[is] ?? is);
  byId("clock").textContent = news.run && !news.run.status ? "" : `${time().toFixed(1)} s`;
  const note = byId("note");
  note.textContent = news.run?.note ?? "";
  note.className = ["failed", "refused"].includes(news.run?.phase) ? "bad" : "";
  byId("stop").hidden = lost || !can("stop");
  byId("again").hidden = lost || !can("again");
  const paces = byId("paces");
  paces.hidden = lost || !can("pace");
  fill(paces, news.paces ?? null, () => [
    element("span", "Speed"),
    ...news.paces.map((name) => {
      const button = element("button", name === "max" ? "max" : `${name}×`);
      button.type = "button";
      button.dataset.pace = name;
      button.title =
        name === "max"
          ? "as fast as this machine allows"
          : name === "1"
            ? "as a real robot"
            : `${name} times faster`;
      button.addEventListener("click", () => post("pace", name));
      return button;
    }),
  ]);
  paces.querySelectorAll("button").forEach((button) => {
    const on = button.dataset.pace === news.pace;
    button.classList.toggle("down", on);
    button.setAttribute("aria-pressed", on);
  });
}
byId("stop").addEventListener("click", () => post("wish", "stop"));
window.addEventListener("keydown", (event) => {
  if (event.key === "Escape" && !event.repeat && !lost && can("stop")) post("wish", "stop");
});
byId("again").addEventListener("click", () => post("wish", "again"));

function legend() {
  const entries = [
    news.sim && ["how it is", `<path d="M1 5H25" stroke="var(--truth)" stroke-width="3"/>`],
    news.run && [
      "what the robot believes",
      `<path d="M1 5H25" stroke="var(--belief)" stroke-width="3"
        ${news.sim ? 'stroke-dasharray="6 4"' : ""}/>`,
    ],
    (kept.points.length || !news.run) && [
      "what it measured",
      `<path d="M3 5h0M10 5h0M17 5h0M24 5h0" stroke="var(--belief)" stroke-width="4"
        stroke-linecap="square"/>`,
    ],
    kept.map?.places.length && [
      "its map",
      `<path d="M3 5H23" stroke="var(--belief)" stroke-opacity=".25" stroke-width="10"/>`,
    ],
    kept.room?.walls.length && [
      "walls",
      `<path d="M1 5H25" stroke="var(--wall)" stroke-width="3"/>`,
    ],
  ].filter(Boolean);
  fill(byId("legend"), entries, () =>
    entries.map(([word, drawing]) => {
      const item = element("li");
      item.innerHTML = `<svg viewBox="0 0 26 10" fill="none">${drawing}</svg>`;
      item.append(word);
      return item;
    }),
  );
}

function gather() {
  if (news.room) {
    kept.room = news.room;
    include(news.room.low, 0);
    include(news.room.high, 0);
  }
  for (const [robot, echo, x, y] of news.sim?.marks ?? []) {
    kept.marks.push([robot, echo, x / 1000, y / 1000]);
    include([x / 1000, y / 1000]);
  }
  if (kept.marks.length > most) kept.marks.splice(0, kept.marks.length - most);
  news.sim?.robots.forEach((robot) => robot.outline.forEach((corner) => include(corner)));
  if (!news.run) return;
  const { path = [], points = [], entered = [], map, status } = news.run;
  for (const [list, more] of [
    [kept.path, path],
    [kept.points, points],
  ]) {
    for (let at = 0; at < more.length; at += 2) {
      list.push(more[at], more[at + 1]);
      include([more[at], more[at + 1]]);
    }
    if (list.length > 2 * most) list.splice(0, list.length - 2 * most);
  }
  if (path.length) kept.grown++;
  if (map) {
    kept.map = map;
    for (let at = 0; at < map.places.length; at += 2)
      include([map.places[at], map.places[at + 1]], map.cell_m / 2);
  }
  // The newest first.
  for (const one of entered) (kept.history[one.machine] ??= []).unshift(one);
  if (status) include([status.x_m, status.y_m]);
}

let failures = 0,
  lost = false;
async function look() {
  try {
    const answer = await fetch(`state?since=${since}`, { cache: "no-store" });
    if (!answer.ok) throw new Error(answer.status);
    const fresh = await answer.json();
    if (fresh.session !== news?.session) {
      kept = empty();
      first_s = null;
      last.clear();
      hand = null;
      view.moved = false;
    }
    news = fresh;
    since = news.next;
    failures = 0;
    gather();
  } catch (error) {
    failures++;
    console.warn(error);
  }
  lost = failures >= 3;
  if (news) {
    draw();
    head();
    mission();
    variables();
    bricks();
    robots();
    done();
    legend();
  } else if (lost) {
    byId("phase").hidden = false;
    byId("phase").textContent = "no answer";
  }
  canvas.dataset.lost = lost;
  setTimeout(look, failures ? 1000 : 140);
}

// A hand on the picture: on a robot it carries or turns it, elsewhere it moves the picture; two
// fingers zoom.
let hand = null,
  hovered = null;
const fingers = new Map();
const here = (event) => {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};
const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

function robotAt(point) {
  if (!can("order")) return null;
  const near = (news.sim?.robots ?? [])
    .map((robot, index) => [apart(px([robot.x_m, robot.y_m]), point), index])
    .sort((a, b) => a[0] - b[0])[0];
  return near && near[0] < Math.max(22, 0.11 * view.scale) ? near[1] : null;
}
const knobAt = (point) =>
  hovered !== null &&
  can("order") &&
  news.sim?.robots[hovered] &&
  apart(px(at(news.sim.robots[hovered], knobAhead(), 0)), point) < 17;

function zoom(factor, [x, y]) {
  const scale = Math.min(1e4, Math.max(2, view.scale * factor)),
    change = scale / view.scale;
  Object.assign(view, {
    scale,
    x: x - (x - view.x) * change,
    y: y - (y - view.y) * change,
    moved: true,
  });
  draw();
}

canvas.addEventListener(
  "wheel",
  (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.0015), here(event));
  },
  { passive: false },
);
canvas.addEventListener("pointerdown", (event) => {
  const point = here(event);
  fingers.set(event.pointerId, point);
  try {
    canvas.setPointerCapture(event.pointerId);
  } catch {
    /* a script's own event */
  }
  const turns = knobAt(point),
    robot = turns ? hovered : robotAt(point);
  hovered = robot ?? null;
  if (robot !== null && fingers.size === 1) {
    const { x_m, y_m, heading_deg } = news.sim.robots[robot],
      [x, y] = metres(point);
    hand = {
      robot,
      turns,
      moves: false,
      from: point,
      by: [x_m - x, y_m - y],
      pose: { x_m, y_m, heading_deg },
    };
  }
  draw();
});
canvas.addEventListener("pointermove", (event) => {
  const now = here(event),
    before = fingers.get(event.pointerId);
  if (!before) {
    const over = knobAt(now) ? hovered : robotAt(now);
    if (over !== hovered && event.pointerType === "mouse") {
      hovered = over;
      canvas.classList.toggle("carries", over !== null);
      draw();
    }
    return;
  }
  const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
  fingers.set(event.pointerId, now);
  if (other) {
    hand = null;
    zoom((apart(now, other) || 1) / (apart(before, other) || 1), now);
    return;
  }
  if (!hand) {
    Object.assign(view, {
      x: view.x + now[0] - before[0],
      y: view.y + now[1] - before[1],
      moved: true,
    });
    draw();
    return;
  }
  const [x, y] = metres(now);
  hand.moves ||= apart(now, hand.from) > 4;
  if (hand.turns)
    hand.pose.heading_deg = Math.round(
      (Math.atan2(y - hand.pose.y_m, x - hand.pose.x_m) * 180) / Math.PI,
    );
  else Object.assign(hand.pose, { x_m: x + hand.by[0], y_m: y + hand.by[1] });
  draw();
});
const up = (event) => {
  fingers.delete(event.pointerId);
  if (hand?.moves && event.type === "pointerup") {
    const { x_m, y_m, heading_deg } = hand.pose;
    order(
      `robot ${hand.robot + 1} place ${x_m.toFixed(3)} ${y_m.toFixed(3)} ${heading_deg.toFixed(1)}`,
    );
  }
  hand = null;
};
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, up);
byId("fit").addEventListener("click", () => {
  view.moved = false;
  draw();
});
canvas.addEventListener("dblclick", () => {
  view.moved = false;
  draw();
});
window.addEventListener("resize", draw);
look();
