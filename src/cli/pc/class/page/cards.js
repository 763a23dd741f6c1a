// All bricks, a card each, what is wrong first; and those that can be introduced.

import { button, element, known, picture, post, put, seconds, stops, write } from "./parts.js";
import { draw } from "./picture.js";

const signs = { driving: "▶", ready: "○", stopped: "■", preparing: "…", stopping: "…" };
export const sign = ({ words, wrong, silent_s: silent }) =>
  silent !== null ? "?" : wrong === 2 ? "✕" : (signs[words] ?? "");

export const stopped = (stop) => {
  if (stop.failed) return `stop: not told: ${stop.failed}`;
  if (stop.told_after_s === null) return `stop: asked ${seconds(stop.asked_s)} ago, not told yet`;
  const told = `stop: told after ${stop.told_after_s.toFixed(2)} s`;
  return stop.still_after_s === null
    ? `${told}, not still yet`
    : `${told}, still after ${stop.still_after_s.toFixed(2)} s`;
};

export const facts = (brick) => {
  const lines = [];
  if (brick.silent_s !== null) lines.push(`no answer for ${seconds(brick.silent_s)}`);
  if (brick.mission) {
    const time =
      brick.elapsed_s === null
        ? ""
        : `, ${Math.floor(brick.elapsed_s)} of ${Math.round(brick.limit_s)} s`;
    lines.push(`${brick.mission}${time}`);
  } else if (brick.state_s !== null && brick.silent_s === null)
    lines.push(`for ${seconds(brick.state_s)}`);
  const kit = [brick.battery, brick.version && `onbrick ${brick.version}`]
    .filter(Boolean)
    .join(", ");
  return [...lines, kit].filter(Boolean);
};

// What is wrong, each with its sign.
export const reasons = ({ why, wrong }) =>
  why.map((one) => `${wrong === 2 ? "✕" : "!"} ${one}`).join("\n");

const number = new Intl.Collator("en", { numeric: true });
const cards = [];
let grid = null;
let moved = 0;

function card(at) {
  const made = element("li", undefined, "card");
  made.dataset.brick = at;
  const map = element("canvas");
  map.setAttribute("role", "img");
  const parts = { made, map };
  const head = put(
    element("div", undefined, "head"),
    (parts.name = element("h2")),
    (parts.state = element("span", "", "state")),
  );
  const facts = put(element("div", undefined, "facts"), (parts.facts = element("div")));
  for (const kind of ["why", "stop-note", "said"])
    put(facts, (parts[kind] = element("p", "", kind)));
  const open = element("a", "Open");
  open.href = `#/brick/${at}`;
  parts.stop = stops(
    button("Stop", () => {}, "stop"),
    at,
  );
  parts.identify = button("Identify", () => post("identify", { brick: at }));
  const hands = put(
    element("div", undefined, "hands"),
    parts.stop,
    parts.identify,
    (parts.open = open),
  );
  put(made, head, map, facts, hands);
  return parts;
}

function fill(parts, brick, at) {
  parts.made.dataset.wrong = brick.silent_s !== null ? 2 : brick.wrong;
  write(parts.name, brick.name);
  parts.name.title = `${brick.address}, ${brick.fingerprint}`;
  write(parts.state, `${sign(brick)} ${brick.words}`);
  write(parts.facts, facts(brick).join("\n"));
  write(parts.why, reasons(brick));
  parts.why.title = reasons(brick);
  write(parts["stop-note"], brick.stop ? stopped(brick.stop) : "");
  const [said, good] = brick.said ?? ["", true];
  write(parts.said, said);
  parts.said.title = said;
  parts.said.classList.toggle("bad", !good);
  parts.stop.setAttribute("aria-label", `Stop ${brick.name}`);
  parts.identify.setAttribute("aria-label", `Identify ${brick.name}: it beeps and blinks`);
  parts.open.setAttribute("aria-label", `Open ${brick.name}`);
  const kept = picture(at);
  const drawn = `${kept.grown} ${brick.pose}`;
  if (drawn === parts.drawn) return;
  parts.drawn = drawn;
  parts.map.setAttribute("aria-label", `Map: ${kept.points.length / 2} points`);
  parts.map.dataset.points = kept.points.length / 2;
  parts.map.dataset.path = kept.path.length / 2;
  draw(parts.map, [{ ...kept, pose: brick.pose }]);
}

// What is wrong comes first; but not under a finger that is about to press something.
function order() {
  const isNew = grid.dataset.ordered !== "true";
  if (!isNew && performance.now() - moved < 3000) return;
  grid.dataset.ordered = known.bricks.length > 0;
  const rank = ({ silent_s: silent, wrong }) => (silent !== null ? 2 : wrong);
  const wanted = known.bricks
    .map((brick, at) => ({ brick, made: cards[at].made }))
    .sort((a, b) => rank(b.brick) - rank(a.brick) || number.compare(a.brick.name, b.brick.name))
    .map(({ made }) => made);
  if (wanted.every((made, at) => grid.children[at] === made)) return;
  const held = document.activeElement;
  grid.append(...wanted);
  if (grid.contains(held)) held.focus({ preventScroll: true });
}

function strangers(place) {
  const key = JSON.stringify(known.strangers);
  if (place.dataset.key === key) return;
  place.dataset.key = key;
  place.replaceChildren(
    ...known.strangers.map(({ name, at, port }) =>
      put(
        element("p", undefined, "row"),
        element("span", `New: ${name} at ${at}`),
        button("Pair", () => post("pair", { address: at, port })),
      ),
    ),
  );
}

function talk(place) {
  const { pairing } = known;
  const key = JSON.stringify(pairing);
  if (place.dataset.key === key) return;
  place.dataset.key = key;
  if (!pairing) return place.replaceChildren();
  const line = (text, kind) => element("p", text, kind);
  const close = () => button("Close", () => post("close", ""));
  const shows = {
    asking: () => [
      line(
        `Asking ${pairing.address}: its pairing window must be open (on the brick: Network, Pair)`,
      ),
    ],
    compare: () => [
      line("Does the brick show this code?"),
      line(pairing.code, "code"),
      line(`It calls itself ${pairing.name}, with the key ${pairing.fingerprint}.`),
      pairing.another &&
        line(
          `A brick ${pairing.name} is known with another key, ${pairing.another}: ` +
            "it is replaced if you say yes.",
          "bad",
        ),
      put(
        element("p", undefined, "row"),
        button("Yes, the same", () => post("answer", "yes")),
        button("No", () => post("answer", "no")),
      ),
    ],
    waits: () => [
      line(pairing.code, "code"),
      line(`Now say on ${pairing.name} that it is the same.`),
    ],
    done: () => [line(`${pairing.name} is known from now on.`), close()],
    failed: () => [line(`Not paired: ${pairing.why}`, "bad"), close()],
  };
  put(place, ...[place.replaceChildren(), ...shows[pairing.stage]()]);
}

export function show(view) {
  grid = element("ul");
  grid.id = "cards";
  grid.addEventListener("pointermove", () => (moved = performance.now()));
  cards.length = 0;
  const heard = element("div");
  const talks = element("div");
  const address = element("input");
  address.placeholder = "ev3-blue.local";
  address.setAttribute("aria-label", "Address of a brick");
  const pair = put(
    element("form", undefined, "row"),
    element("span", "Another brick:"),
    address,
    element("button", "Pair"),
  );
  pair.addEventListener("submit", (event) => {
    event.preventDefault();
    if (address.value.trim()) post("pair", { address: address.value.trim() });
  });
  const panel = put(element("section", undefined, "panel"), talks, heard, pair);
  panel.id = "pairing";
  put(view, grid, panel);
  return () => {
    known.bricks.forEach((brick, at) => {
      if (!cards[at]) put(grid, (cards[at] = card(at)).made);
      fill(cards[at], brick, at);
    });
    order();
    strangers(heard);
    talk(talks);
    // While something is to be decided it stands above the cards.
    panel.classList.toggle("first", Boolean(known.pairing));
    const first = known.pairing ? panel : grid;
    if (view.firstElementChild !== first) view.prepend(first);
  };
}
