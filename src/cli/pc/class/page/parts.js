// What all views use: elements, requests, and what is known by now.

export const element = (name, text, kind) => {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
};

export const put = (parent, ...children) => {
  parent.append(...children.filter(Boolean));
  return parent;
};

export const button = (text, act, kind) => {
  const made = element("button", text, kind);
  made.type = "button";
  made.addEventListener("click", act);
  return made;
};

// A text is written only where it changes, so that a person may mark and copy it.
export const write = (place, text) => {
  if (place.textContent !== text) place.textContent = text;
};

let quiet = null;
export const tell = (text) => {
  const told = document.getElementById("told");
  told.textContent = text;
  told.hidden = false;
  clearTimeout(quiet);
  quiet = setTimeout(() => (told.hidden = true), 8000);
};

const SILENT = "the program that shows this page does not answer";

export const get = async (path) => {
  const answer = await fetch(path, { cache: "no-store" }).catch(() => {
    throw new Error(SILENT);
  });
  if (!answer.ok) throw new Error((await answer.text()).trim());
  return answer.json();
};

// Posts, and says on the page what is refused; the answer where it was done.
const sent = async (path, value, more) => {
  const body = typeof value === "string" ? value : JSON.stringify(value);
  const headers = { "X-Onbrick": "1" };
  try {
    const answer = await fetch(path, { method: "POST", headers, body, ...more });
    if (answer.ok) return answer;
    tell((await answer.text()).trim());
  } catch {
    tell(SILENT);
  }
  return null;
};
export const post = async (path, value, more) => Boolean(await sent(path, value, more));
export const askFor = async (path, value, more) => (await sent(path, value, more))?.json();

export const seconds = (value) => {
  if (value < 10) return `${value.toFixed(1)} s`;
  if (value < 100) return `${Math.round(value)} s`;
  return `${Math.floor(value / 60)} min ${Math.floor(value % 60)} s`;
};

// The last state, and what has gathered of each brick's picture.
export const known = { bricks: [], strangers: [], pairing: null, together: null };
const pictures = [];

export const picture = (number) =>
  (pictures[number] ??= {
    session: null,
    next: "",
    path: [],
    points: [],
    ahead: [],
    pose: null,
    grown: 0,
  });

export const gather = (state) => {
  Object.assign(known, state);
  state.bricks.forEach(({ glimpse, pose }, number) => {
    const kept = picture(number);
    if (kept.session !== glimpse.session)
      Object.assign(kept, { session: glimpse.session, path: [], points: [], pose: null });
    kept.pose = pose ?? kept.pose;
    kept.path.push(...glimpse.path);
    kept.points.push(...glimpse.points);
    const changed =
      glimpse.path.length + glimpse.points.length + glimpse.ahead.length + kept.ahead.length;
    Object.assign(kept, { next: glimpse.next, ahead: glimpse.ahead });
    if (changed) kept.grown++;
  });
};

export const cursors = () => pictures.map(({ next }) => next).join("_");

// The state is asked for at once after what a person does.
let wake = () => {};
export const awaited = (ms) =>
  new Promise((done) => {
    const timer = setTimeout(done, ms);
    wake = () => {
      clearTimeout(timer);
      done();
    };
  });
export const lookNow = () => wake();

export const stop = (brick) => {
  post("stop", brick === undefined ? "" : { brick }).then(lookNow);
};

// Stops all, wherever on the page a person is.
export const stopsByKey = (place) =>
  place.addEventListener("keydown", (event) => event.key === "Escape" && !event.repeat && stop());

// A live page inside this one; it has its own keys, so that Escape has to be heard there, too.
export const framed = (title) => {
  const made = element("iframe");
  Object.assign(made, { title, hidden: true });
  made.addEventListener("load", () => stopsByKey(made.contentWindow));
  return made;
};

// A stop is asked for when the finger comes down, and not only when it leaves.
export const stops = (made, brick) => {
  made.addEventListener("pointerdown", () => stop(brick));
  made.addEventListener("click", (event) => event.detail === 0 && stop(brick));
  return made;
};
