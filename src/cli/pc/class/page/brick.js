// One brick: its run as it is driven, its runs, and the recordings that are here.

import { button, element, framed, get, known, post, put, stops, tell, write } from "./parts.js";
import { facts, reasons, stopped } from "./cards.js";

const megabytes = (bytes) => `${(bytes / 1e6).toFixed(1)} MB`;

function row(at, { info, arrival }, here, act) {
  const ended = info.going_on ? "going on" : (info.end?.word ?? "cut");
  const found =
    info.travelled_m === null ? "" : `${info.travelled_m.toFixed(1)} m, ${info.points ?? 0} points`;
  const cells = [info.run, info.mission, found, megabytes(info.bytes), ended].map((text) =>
    element("td", text),
  );
  const last = element("td");
  if (arrival?.failed) put(last, element("span", arrival.failed, "bad"));
  if (here)
    put(
      last,
      button("Map", () => act.map(info.run)),
    );
  else if (arrival && !arrival.failed && !arrival.whole)
    put(last, element("span", `${megabytes(arrival.bytes)} here`));
  else
    put(
      last,
      button("Fetch", () => post("fetch", { brick: at, run: info.run }).then(act.look)),
    );
  return put(element("tr"), ...cells, last);
}

function file(at, name, act) {
  const to = element("input");
  to.value = name;
  to.setAttribute("aria-label", `Another name for ${name}`);
  const remove = button("Delete", () => {
    if (remove.dataset.sure) post("delete", { brick: at, run: name }).then(act.look);
    remove.dataset.sure = "1";
    remove.textContent = "Delete: sure?";
  });
  const rename = button("Rename", () =>
    post("rename", { brick: at, run: name, to: to.value.trim() }).then(act.look),
  );
  const cell = put(
    element("td", undefined, "row"),
    to,
    rename,
    remove,
    button("Map", () => act.map(name)),
  );
  return put(element("tr"), cell);
}

export function show(view, at) {
  const name = element("h2");
  const words = element("p");
  const why = element("p", "", "why");
  const hands = put(
    element("p", undefined, "row"),
    stops(
      button("Stop", () => {}, "stop"),
      at,
    ),
    button("Identify", () => post("identify", { brick: at })),
  );
  const frame = framed("The run, live");
  const map = element("img", undefined, "map");
  map.alt = "The map of a recording";
  map.hidden = true;
  const there = element("tbody");
  there.id = "runs";
  const missing = element("p", "", "soft");
  const here = element("tbody");
  const folder = element("p", "", "soft");
  const ports = element("tbody");
  ports.id = "ports";
  const driving = element("p", "", "soft");
  const act = {
    look,
    map: (run) => {
      map.src = `map/${at}/${run}`;
      map.hidden = false;
      map.scrollIntoView({ block: "nearest" });
    },
  };
  map.addEventListener("error", () => map.src && tell("there is no picture of that recording"));
  const wide = (body, ...heads) => {
    const head = put(element("tr"), ...heads.map((text) => element("th", text)));
    const table = put(element("table"), put(element("thead"), head), body);
    return put(element("div", undefined, "wide"), table);
  };
  const runs = put(
    element("section", undefined, "panel"),
    element("h2", "Runs on the brick"),
    wide(there, "Run", "Mission", "Found", "Size", "Ended"),
    missing,
    element("h2", "Recordings here"),
    wide(here),
    folder,
    element(
      "p",
      "Over the network a brick deletes nothing: delete its runs at the brick, in its menu.",
      "soft",
    ),
    map,
  );
  const left = put(
    element("section", undefined, "panel"),
    name,
    words,
    why,
    hands,
    frame,
    element("h2", "Ports"),
    wide(ports, "Port", "Role", "Reads", "Device"),
    driving,
  );
  const one = put(element("div"), left, runs);
  one.id = "one";
  put(view, one);
  // Rows are made again only where they change: a person may be typing in one.
  const keys = {};
  const differs = (name, value) => {
    const key = JSON.stringify(value);
    return keys[name] !== key && Boolean((keys[name] = key));
  };
  async function look() {
    try {
      const found = await get(`runs/${at}`);
      const has = new Set(found.here);
      if (differs("here", found.here)) {
        here.replaceChildren(...found.here.map((one) => file(at, one, act)));
      }
      if (differs("there", found)) {
        const runs = found.there ?? [];
        there.replaceChildren(...runs.map((run) => row(at, run, has.has(run.info.run), act)));
        write(missing, found.there ? (runs.length ? "" : "none yet") : "not told yet");
      }
      write(folder, found.folder);
    } catch (error) {
      tell(error.message);
    }
  }
  async function readPorts() {
    try {
      const found = await get(`ports/${at}`);
      const rows = (found ?? []).map(({ port, driver, role, reading }) =>
        put(
          element("tr"),
          ...[port, role ?? "", reading, driver].map((text) => element("td", text)),
        ),
      );
      ports.replaceChildren(...rows);
      const none = found ? "nothing is plugged in" : "not told now; a recording has them of a run";
      write(driving, rows.length ? "" : none);
    } catch (error) {
      tell(error.message);
    }
  }
  look();
  let turn = 0;
  return () => {
    const brick = known.bricks[at];
    if (!brick) return;
    write(name, brick.name);
    write(
      words,
      // The detail has the mission and its time.
      [
        brick.words,
        ...facts({ ...brick, mission: null }),
        brick.detail,
        brick.stop && stopped(brick.stop),
      ]
        .filter(Boolean)
        .join("; "),
    );
    left.dataset.wrong = brick.wrong;
    write(why, reasons(brick));
    if (brick.glimpse.session && frame.hidden) {
      frame.hidden = false;
      frame.src = `live/${at}/`;
    }
    if (++turn % 6 === 0) look();
    if (turn % 2 === 0) readPorts();
  };
}
