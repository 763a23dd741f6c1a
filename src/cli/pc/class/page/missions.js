// Missions: files to write, what is found in them as one types, a trial, and a start on bricks.

import {
  askFor,
  button,
  element,
  framed,
  get,
  known,
  lookNow,
  post,
  put,
  tell,
  write,
} from "./parts.js";

const kept = { name: "", text: "", saved: "" };
// What was to be saved last could not be.
let isAtRisk = false;

const option = (value) => element("option", value);
const labelled = (text, field) =>
  put(element("label", undefined, "row"), element("span", text), field);

// The place of a finding, as the program counts it, in the text.
const place = (text, line, column) => {
  const before = text.split("\n").slice(0, line - 1);
  return before.reduce((sum, one) => sum + one.length + 1, 0) + column - 1;
};

// Saves what differs from what was saved last; also while the page is being closed.
export async function save(more) {
  const { name, text, saved } = kept;
  isAtRisk &&= text !== saved;
  if (!name || text === saved) return true;
  const changed = await askFor("save", { name, text, known: saved }, more);
  if (changed) tell(`${name}.toml was changed elsewhere meanwhile; that text is kept, too`);
  const done = changed !== undefined;
  if (done && kept.name === name) kept.saved = text;
  isAtRisk = !done;
  return done;
}
addEventListener("pagehide", () => save({ keepalive: true }));
addEventListener("beforeunload", (event) => isAtRisk && event.preventDefault());

export function show(view) {
  const files = element("ul", undefined, "list");
  const templates = element("select");
  const name = element("input");
  name.placeholder = "my-mission";
  const area = element("textarea");
  area.spellcheck = false;
  area.setAttribute("aria-label", "The mission's text");
  const gutter = element("pre");
  gutter.setAttribute("aria-hidden", "true");
  const findings = element("ul", undefined, "findings");
  const verdict = element("p", "", "soft");
  verdict.id = "verdict";
  const title = element("h2", "No mission is open");
  const versions = element("select");
  const frame = framed("The trial");
  const worlds = element("select");
  const boxes = element("div", undefined, "row");
  let marks = new Map();
  let waiting = null;

  const number = () => {
    const lines = area.value.split("\n").map((_, at) => {
      const bad = marks.get(at + 1);
      return element(
        "span",
        `${bad ? (bad.severity === "error" ? "✕ " : "! ") : ""}${at + 1}\n`,
        bad ? "bad" : undefined,
      );
    });
    gutter.replaceChildren(...lines);
    gutter.scrollTop = area.scrollTop;
  };

  async function check() {
    if (!kept.name) return;
    const { name, text } = kept;
    const found = await askFor("check", { name, text });
    if (!found || text !== kept.text) return;
    marks = new Map(found.findings.map((one) => [one.line, one]));
    number();
    findings.replaceChildren(
      ...found.findings.map((one) => {
        const hint = one.hint ? ` (${one.hint})` : "";
        const go = () => {
          const at = place(area.value, one.line, one.column);
          area.focus();
          area.setSelectionRange(at, at);
        };
        return put(
          element("li"),
          button(
            `${one.line}:${one.column} ${one.message}${hint}`,
            go,
            one.severity === "error" ? "bad" : "",
          ),
        );
      }),
    );
    write(
      verdict,
      found.good ? `in order: ${found.name}, ${found.limit_s} s at most` : "not in order yet",
    );
    verdict.dataset.good = found.good;
  }

  const edited = () => {
    kept.text = area.value;
    number();
    clearTimeout(waiting);
    waiting = setTimeout(() => {
      save().then(history);
      check();
    }, 400);
  };
  area.addEventListener("input", edited);
  area.addEventListener("scroll", () => (gutter.scrollTop = area.scrollTop));

  function open(name, text, saved) {
    Object.assign(kept, { name, text, saved });
    area.value = text;
    write(title, `${name}.toml`);
    area.disabled = false;
    number();
    check();
    list();
    history();
  }

  const read = async (path) => {
    try {
      return await get(path);
    } catch (error) {
      tell(error.message);
      return null;
    }
  };

  async function choose(name) {
    if (!(await save())) return;
    const text = await read(`missions/text?name=${name}`);
    if (text !== null) open(name, text, text);
  }

  async function list() {
    const { missions, templates: shipped } = await get("missions");
    files.replaceChildren(
      ...missions.map((one) => {
        const made = button(one, () => choose(one));
        if (one === kept.name) made.setAttribute("aria-current", "true");
        return put(element("li"), made);
      }),
    );
    if (!templates.options.length) put(templates, ...shipped.map(option));
    return missions;
  }

  async function create() {
    const wanted = name.value.trim();
    if (!wanted) return name.focus();
    if ((await list()).includes(wanted)) return tell(`${wanted} is there already`);
    if (!(await save())) return;
    const text = await read(`missions/template?name=${templates.value}&called=${wanted}`);
    if (text === null || !(await post("save", { name: wanted, text }))) return;
    name.value = "";
    open(wanted, text, text);
  }

  const when = (stamp) => {
    const [ms, ...brick] = stamp.split("-");
    const time = new Date(Number(ms)).toLocaleString();
    return brick.length ? `${time}, on ${brick.join("-")}` : time;
  };
  async function history() {
    const { name } = kept;
    const stamps = await read(`missions/versions?name=${name}`);
    if (!stamps || name !== kept.name) return;
    const chosen = versions.value;
    versions.replaceChildren(
      ...stamps.map((stamp) => Object.assign(option(when(stamp)), { value: stamp })),
    );
    // What a person has chosen stays chosen.
    if (stamps.includes(chosen)) versions.value = chosen;
  }
  async function back() {
    if (!versions.value) return;
    if (!(await save())) return;
    const text = await read(`missions/version?name=${kept.name}&stamp=${versions.value}`);
    if (text === null) return;
    area.value = text;
    edited();
  }

  async function trial() {
    if (!kept.name) return tell("open a mission first");
    if (!(await save())) return;
    const { name, text } = kept;
    if (!(await post("try", { name, text, world: worlds.value }))) return;
    if (frame.hidden) {
      frame.hidden = false;
      frame.src = "try/";
    }
  }

  const chosen = () => [...boxes.querySelectorAll("input:checked")].map((box) => Number(box.value));
  async function start(bricks) {
    if (!kept.name) return tell("open a mission first");
    if (!bricks.length) return tell("choose a brick");
    if (!(await save())) return;
    await check();
    if (verdict.dataset.good === "false") return tell("the mission is not in order yet");
    const { name, text } = kept;
    if (await post("start", { bricks, name, text })) location.hash = "#/";
    lookNow();
  }

  const fresh = put(
    element("form"),
    labelled("Name", name),
    labelled("From", templates),
    element("button", "New mission"),
  );
  fresh.addEventListener("submit", (event) => {
    event.preventDefault();
    create();
  });
  area.disabled = true;
  const work = put(
    element("div"),
    put(element("section", undefined, "panel"), element("h2", "Missions"), files, fresh),
    put(
      element("section", undefined, "panel"),
      title,
      put(element("div", undefined, "editor"), gutter, area),
      verdict,
      findings,
      put(element("p", undefined, "row"), labelled("Kept", versions), button("Bring back", back)),
    ),
    put(
      element("section", undefined, "panel"),
      element("h2", "Start on"),
      boxes,
      put(
        element("p", undefined, "row"),
        button("Start on the chosen", () => start(chosen())),
        button("Start on all", () => start(known.bricks.map((_, at) => at))),
      ),
      element("h2", "Try it here"),
      put(element("p", undefined, "row"), labelled("World", worlds), button("Try it here", trial)),
      frame,
    ),
  );
  work.id = "work";
  put(view, work);
  if (kept.name) open(kept.name, kept.text, kept.saved);
  else list();
  get("worlds").then((names) => put(worlds, ...names.map(option)));
  return () => {
    const names = known.bricks.map(({ name }) => name);
    if (boxes.dataset.names === names.join()) return;
    boxes.dataset.names = names.join();
    boxes.replaceChildren(
      ...names.map((one, at) => {
        const box = element("input");
        Object.assign(box, { type: "checkbox", value: at });
        return put(element("label"), box, element("span", one));
      }),
    );
  };
}
