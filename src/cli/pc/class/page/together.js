// Several bricks as a team: where each starts, one mission for all, and one map that grows.

import { sign } from "./cards.js";
import { button, element, get, known, lookNow, picture, post, put, tell, write } from "./parts.js";
import { colour, draw } from "./picture.js";

// Where each brick starts: metres, metres, degrees; kept while the page is open.
const poses = new Map();
const chosen = new Set();
// The mission that was chosen last.
let wanted = "";

export function show(view) {
  const field = element("canvas");
  field.id = "field";
  field.setAttribute("role", "img");
  const rows = element("tbody");
  const missions = element("select");
  const map = element("img", undefined, "map");
  map.alt = "The map of all recordings";
  map.hidden = true;
  let shown = null;
  let names = "";
  let held = null;
  let states = [];

  // A brick of the team as it drives, and any other where it is to start.
  const tracks = () =>
    [...chosen].map((at, turn) => {
      const { name } = known.bricks[at];
      const [x, y, degrees] = poses.get(at);
      const runs = known.together?.members.some(([brick]) => brick === at);
      const found = runs ? picture(at) : { path: [], points: [], ahead: [] };
      const pose = found.pose ?? [x, y, (degrees * Math.PI) / 180];
      return { ...found, name, paint: colour(turn), pose };
    });
  const drawn = () => {
    const all = tracks();
    shown = draw(field, all, 3);
    const points = all.reduce((sum, track) => sum + track.points.length / 2, 0);
    field.dataset.points = points;
    field.setAttribute("aria-label", `${all.length} robots, ${points} points`);
  };

  const numbered = (at, axis, label) => {
    const made = element("input");
    Object.assign(made, {
      type: "number",
      step: axis === 2 ? 15 : 0.1,
      value: poses.get(at)[axis],
    });
    made.setAttribute("aria-label", `${label} of ${known.bricks[at].name}`);
    made.addEventListener("input", () => {
      // An empty field, or half a number, is none.
      if (!Number.isNaN(made.valueAsNumber)) poses.get(at)[axis] = made.valueAsNumber;
      drawn();
    });
    made.addEventListener("change", () => (made.value = poses.get(at)[axis]));
    return put(element("td"), made);
  };
  // How each brick is, and what came of its start.
  const told = () =>
    states.forEach((place, at) => {
      const brick = known.bricks[at];
      const [said, good] = brick.said ?? ["", true];
      const state = `${sign(brick)} ${brick.words}`;
      write(place, chosen.has(at) && said ? `${state}; ${said}` : state);
      place.className = chosen.has(at) && !good ? "bad" : "soft";
    });
  const list = () => {
    states = known.bricks.map(() => element("div"));
    rows.replaceChildren(
      ...known.bricks.map((brick, at) => {
        if (!poses.has(at)) poses.set(at, [0, at, 0]);
        const box = element("input");
        Object.assign(box, { type: "checkbox", checked: chosen.has(at) });
        box.addEventListener("change", () => {
          chosen[box.checked ? "add" : "delete"](at);
          told();
          drawn();
        });
        const who = put(element("label"), box, element("span", brick.name));
        return put(
          element("tr"),
          put(element("td"), who, states[at]),
          ...["x", "y", "Heading"].map((label, axis) => numbered(at, axis, label)),
        );
      }),
    );
    told();
    drawn();
  };

  // A robot is carried with the pointer, and turned with the wheel.
  const near = (event) => {
    const box = field.getBoundingClientRect();
    const point = [event.clientX - box.left, event.clientY - box.top];
    const away = (at) => {
      const [x, y] = shown.px(poses.get(at)[0], poses.get(at)[1]);
      return Math.hypot(x - point[0], y - point[1]);
    };
    const [first] = [...chosen].sort((a, b) => away(a) - away(b));
    return { at: first !== undefined && away(first) < 30 ? first : null, point };
  };
  const round = (value) => Math.round(value * 20) / 20;
  field.addEventListener("pointerdown", (event) => {
    const { at } = near(event);
    held = at === null ? null : { at, metres: shown.metres };
    if (held) field.setPointerCapture(event.pointerId);
  });
  field.addEventListener("pointermove", (event) => {
    if (!held) return;
    const { point } = near(event);
    const [x, y] = held.metres(...point);
    poses.set(held.at, [round(x), round(y), poses.get(held.at)[2]]);
    drawn();
  });
  field.addEventListener("pointerup", () => {
    if (held) list();
    held = null;
  });
  field.addEventListener(
    "wheel",
    (event) => {
      const { at } = near(event);
      if (at === null) return;
      event.preventDefault();
      const pose = poses.get(at);
      pose[2] = ((pose[2] - Math.sign(event.deltaY) * 15 + 540) % 360) - 180;
      list();
    },
    { passive: false },
  );

  async function start() {
    const kind = missions.selectedOptions[0].dataset.kind;
    const text = await get(`missions/${kind}?name=${missions.value}`);
    const members = [...chosen].map((brick) => ({ brick, pose: poses.get(brick) }));
    map.hidden = true;
    const asked = await post("team", { members, name: missions.value, text });
    if (asked) tell(`${members.length} bricks are asked to start ${missions.value}`);
    lookNow();
  }
  const whole = () => {
    map.src = `map/team?${Date.now()}`;
    map.hidden = false;
  };
  map.addEventListener("error", () => {
    map.hidden = true;
    tell("there is no recording of the team yet");
  });

  const head = put(
    element("tr"),
    ...["Brick", "x, m", "y, m", "Heading, °"].map((text) => element("th", text)),
  );
  const team = put(
    element("div"),
    put(
      element("section", undefined, "panel"),
      element("h2", "Where each starts, in one frame for all"),
      put(
        element("div", undefined, "wide"),
        put(element("table"), put(element("thead"), head), rows),
      ),
      put(
        element("p", undefined, "row"),
        put(element("label"), element("span", "Mission "), missions),
        button("Start together", start),
        button("Picture of the recordings", whole),
      ),
      element(
        "p",
        "In the drawing: carry a robot with the pointer, turn it with the wheel; or type numbers.",
        "soft",
      ),
      map,
    ),
    put(element("section", undefined, "panel"), field),
  );
  team.id = "team";
  put(view, team);
  get("missions").then(({ missions: own, templates }) => {
    const shipped = templates.filter((name) => name !== "template" && !own.includes(name));
    const options = (kind, names) =>
      names.map((name) => {
        const made = element("option", name);
        made.dataset.kind = kind;
        return made;
      });
    put(missions, ...options("text", own), ...options("template", shipped));
    if (wanted) missions.value = wanted;
  });
  missions.addEventListener("change", () => (wanted = missions.value));
  known.together?.members.forEach(([at, pose]) => {
    chosen.add(at);
    poses.set(at, [...pose]);
  });
  return () => {
    const now = known.bricks.map(({ name }) => name).join();
    if (now !== names) list();
    else drawn();
    told();
    names = now;
  };
}
