// The page: asks how the bricks are twice a second, shows one view, and stops what is to stop.

import {
  awaited,
  cursors,
  gather,
  get,
  known,
  lookNow,
  stops,
  stopsByKey,
  write,
} from "./parts.js";
import * as brick from "./brick.js";
import * as cards from "./cards.js";
import * as missions from "./missions.js";
import * as together from "./together.js";

const byId = (id) => document.getElementById(id);
const views = { "": cards.show, missions: missions.show, together: together.show };
let refresh = null;

function route() {
  const [, name = "", at] = location.hash.split("/");
  const view = byId("view");
  missions.save();
  view.replaceChildren();
  refresh = name === "brick" ? brick.show(view, Number(at)) : (views[name] ?? cards.show)(view);
  const under = name === "brick" ? "" : name;
  for (const link of document.querySelectorAll("nav a")) {
    if (link.hash === `#/${under}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  lookNow();
}

const count = (holds) => known.bricks.filter(holds).length;

function summary() {
  const driving = count(({ state, silent_s: silent }) => state === "running" && silent === null);
  const wrong = count((one) => one.silent_s !== null || one.wrong === 2);
  const all = known.bricks.length;
  write(
    byId("summary"),
    `${all} ${all === 1 ? "brick" : "bricks"}: ${driving} driving, ${wrong} wrong`,
  );
}

// How far the last stops are: for half a minute, and as long as one was not told.
function stopping() {
  const asked = known.bricks.filter(
    ({ stop }) => stop && (stop.asked_s < 30 || stop.told_after_s === null),
  );
  const told = asked.filter(({ stop }) => stop.told_after_s !== null);
  const still = asked.filter(({ stop }) => stop.still_after_s !== null);
  const missing = asked.filter(({ stop }) => stop.told_after_s === null).map(({ name }) => name);
  const place = byId("stopped");
  place.hidden = !asked.length;
  byId("summary").hidden = !place.hidden;
  const open = missing.length ? `; not told: ${missing.join(", ")}` : "";
  write(place, `Stop: ${asked.length} asked, ${told.length} told, ${still.length} still${open}`);
  return asked.some(({ stop }) => stop.still_after_s === null && stop.asked_s < 20);
}

// What a person has written stays: it may be in no file yet.
function lost(isLost) {
  byId("view").classList.toggle("lost", isLost);
  byId("summary").classList.toggle("bad", isLost);
  if (!isLost) return;
  byId("stopped").hidden = true;
  byId("summary").hidden = false;
  write(byId("summary"), "no answer: what is below is old, and the program may have ended");
}

async function look() {
  let failures = 0;
  let turns = 0;
  for (;;) {
    let isClose = false;
    const begun = performance.now();
    try {
      gather(await get(`state?since=${cursors()}`));
      if (failures) missions.save();
      failures = 0;
      summary();
      isClose = stopping();
      refresh?.();
      document.body.dataset.turns = ++turns;
    } catch (error) {
      console.warn(error);
      failures++;
    }
    lost(failures >= 3);
    document.body.dataset.failures = failures;
    await awaited(Math.max(40, (isClose ? 120 : 500) - (performance.now() - begun)));
  }
}

stops(byId("stop-all"));
stopsByKey(window);
addEventListener("hashchange", route);
route();
look();
