// Draws the frames that the server sends. It holds the rows itself and moves the axes itself, so
// that nothing goes back to the server but where a recording is to go on; frames that wait are drawn
// together.
"use strict";
// Whenever bokeh paints it writes the style sheets of its axes again, though they are as they were, and
// the browser works out all styles again, six times a frame: a sheet that stays the same is left.
const text = Object.getOwnPropertyDescriptor(Node.prototype, "textContent");
Object.defineProperty(HTMLStyleElement.prototype, "textContent", {
  get() { return text.get.call(this); },
  set(css) { if (css !== text.get.call(this)) text.set.call(this, css); },
});
const held = {}, least = {}, models = {};
const model = (name) => (models[name] ??= Bokeh.documents[0].get_model_by_name(name));
const waiting = [];
const hidden = new Set(); // names of curves
let played = false, seeking = false;
let estimators = { selected: -1, names: [], parameters: {} }, chosen = null;
const estimate = () => chosen ?? estimators.selected;
let socket = null, paused = false, lost = false, drawn = 0;

function decoded(text) {
  const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  return new Float64Array(bytes.buffer);
}

function joined(old, fresh, keep) {
  const rest = Math.max(0, Math.min(old.length, keep - fresh.length));
  const both = new Float64Array(rest + fresh.length);
  both.set(old.subarray(old.length - rest));
  both.set(fresh, rest);
  return both;
}

function take(frame, touched) {
  if (frame.whole) for (const name of Object.keys(held)) delete held[name];
  if (frame.playback) follow(frame.playback);
  for (const [id, html] of Object.entries(frame.words)) document.getElementById(id).innerHTML = html;
  for (const [name, told] of Object.entries(frame.plots)) {
    model(name).left[0].axis_label = told.label;
    least[name] = told.least;
  }
  if (frame.estimators) offer(frame.estimators, touched);
  for (const [name, { replace, keep, columns }] of Object.entries(frame.sources)) {
    const rows = replace ? {} : (held[name] ?? {});
    for (const [column, text] of Object.entries(columns)) {
      rows[column] = joined(rows[column] ?? new Float64Array(), decoded(text), keep);
    }
    held[name] = rows;
    touched.add(name === `estimate ${estimate()}` ? "parameters" : name);
  }
}

// The estimators to choose from, and the titles of the plots of the one that is looked at.
function offer(told, touched) {
  const choice = control("estimator");
  if (choice.options.length !== told.names.length + 1) {
    const options = told.names.map((name, row) => new Option(name, row));
    choice.replaceChildren(choice.options[0], ...options);
  }
  estimators = told;
  touched.add("parameters");
}

function title() {
  const parameters = estimators.parameters[estimate()] ?? [];
  for (let place = 0; ; place++) {
    const plot = model(`plot_parameter${place}`);
    if (!plot) return;
    plot.title.text = parameters[place]?.title ?? "no model selected yet";
    plot.left[0].axis_label = parameters[place]?.label ?? "";
    plot.visible = place === 0 || place < parameters.length; // without any the page would not say why
  }
}

// A source of which nothing has come yet.
function blank(name) {
  const columns = Object.keys(model(name).data);
  return Object.fromEntries(columns.map((column) => [column, new Float64Array([NaN])]));
}

// The least and the largest finite value of some columns, null where there is none.
function limits(columns) {
  let low = Infinity, high = -Infinity;
  for (const values of columns) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low <= high ? [low, high] : null;
}

// An axis moves only when it must: a scale that trembles with every frame cannot be read.
// A still signal is shown as still: an axis is never less high than its least.
function fit(range, [lowest, highest], least) {
  const span = Math.max(highest - lowest, least, 1e-9 * Math.abs(highest), 1e-12);
  const spare = (span - (highest - lowest)) / 2, low = lowest - spare, high = highest + spare;
  const holds = range.start <= low && high <= range.end;
  if (!holds || range.end - range.start > 2.2 * span) {
    range.setv({ start: low - 0.15 * span, end: high + 0.15 * span });
  }
}

// A band ends where it is unknown: bokeh would draw it on to where it is known again.
function closed(rows) {
  const shown = { ...rows };
  for (let place = 0; `p${place}` in rows; place++) {
    const value = rows[`p${place}`], known = rows[`low${place}`].map((edge) => !isNaN(edge));
    const low = rows[`low${place}`].slice(), high = rows[`high${place}`].slice();
    for (let i = 0, last = NaN; i < value.length; i++) {
      if (known[i]) last = value[i];
      else low[i] = high[i] = known[i + 1] ? value[i + 1] : last;
    }
    shown[`low${place}`] = low;
    shown[`high${place}`] = high;
  }
  return shown;
}

// Range of an axis: the newest value and the held ones; without held ones every value.
function extent(columns, values) {
  const found = limits(columns);
  return found ? limits([found, values.slice(-1)]) : limits([values]);
}

// As the report's: 1.5 times the bound of 95 in 100 values, so that no spike sets the scale.
function robust(values) {
  const sizes = values.filter((one) => !isNaN(one)).map(Math.abs).sort();
  const most = 1.5 * (sizes[Math.floor(0.95 * sizes.length)] ?? NaN);
  return most > 0 ? [-most, most] : limits([values]);
}

function show(touched) {
  if (touched.has("parameters")) {
    held.parameters = held[`estimate ${estimate()}`] ?? blank("parameters");
    title();
  }
  for (const name of touched) {
    if (name.startsWith("estimate ")) continue; // of one that another browser looks at
    model(name).data = name === "parameters" ? closed(held[name]) : { ...held[name] };
  }
  const end = held.slave?.t.at(-1);
  for (const [name, [shown, value]] of Object.entries(settings.plots)) {
    const plot = model(name);
    const scrolls = name !== "plot_correlation";
    if (!shown.some(([source]) => touched.has(source))) continue;
    const rows = ([source, column]) => held[source]?.[column] ?? [];
    const visible = shown.filter(([, column]) => !hidden.has(`${name}.${column}`));
    const wide = name === "plot_residual" ? robust(rows(shown[0])) : null;
    const found = wide ?? extent(visible.map(rows), value ? rows(value) : []);
    if (found) fit(plot.y_range, found, least[name] ?? 0);
    if (scrolls && end !== undefined) {
      const start = Math.max(0, end - settings.window_s);
      plot.x_range.setv({ start, end: start + settings.window_s });
    }
    if (!scrolls && held.correlation?.lag.length) {
      const { lag, width } = held.correlation;
      plot.x_range.setv({ start: lag[0] - width[0], end: lag.at(-1) + width[0] });
    }
  }
}

// The controls of a playback follow it, but for the one that is being held.
const control = (name) => document.getElementById(name);
function follow({ place_s, length_s, speed, playing, loops }) {
  control("playback").hidden = false;
  control("seek").max = length_s;
  if (document.activeElement !== control("seek") || !seeking) control("seek").value = place_s;
  control("place").textContent = `${place_s.toFixed(1)} of ${length_s.toFixed(1)} s`;
  if (document.activeElement !== control("speed")) control("speed").value = String(speed);
  control("again").checked = loops;
  played = true;
  if (playing === paused) { paused = !playing; name_pause(); }
}

function ask(asked) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(asked));
}

function paint() {
  const touched = new Set();
  for (const frame of waiting.splice(0)) take(frame, touched);
  const wait = control("waiting"); // axes without a row would show an invented scale
  if (!wait.hidden) wait.hidden = Object.values(held).some((rows) => rows.t?.some(Number.isFinite));
  show(touched);
  drawn += 1;
}

function listen() {
  socket = new WebSocket(`${location.origin.replace("http", "ws")}/frames`);
  const mine = socket;
  socket.onopen = () => {
    if (lost) location.reload();
    ask({ estimator: chosen });
  };
  socket.onmessage = (event) => {
    if (waiting.push(JSON.parse(event.data)) === 1) requestAnimationFrame(paint);
  };
  socket.onclose = () => {
    if (mine !== socket) return;
    lost = true;
    document.getElementById("gone").classList.add("shown");
    setTimeout(listen, 2000);
  };
}

// A page that is paused or out of sight hears nothing; then it is told everything afresh.
function attend() {
  const looks = (!paused || played) && !document.hidden;
  if (looks && socket === null) listen();
  if (!looks && socket !== null) {
    const line = socket;
    socket = null;
    line.close();
  }
}

function name_pause() {
  control("pause").setAttribute("aria-pressed", paused);
  control("pause").textContent = paused ? "Resume" : "Pause";
}

// A recording is held where it is; a run goes on, and the page looks away from it.
function pause() {
  paused = !paused;
  name_pause();
  if (played) ask({ play: !paused });
  else attend();
}

function theme() {
  location.search = settings.dark ? "?theme=light" : "?theme=dark";
}

let before = 0;
setInterval(() => {
  const rate = paused ? "paused" : `${drawn - before} frames/s`;
  document.getElementById("frames").textContent = rate;
  before = drawn;
}, 1000);
control("seek").addEventListener("input", ({ target }) => { seeking = true; control("place").textContent = `${Number(target.value).toFixed(1)} s`; });
control("seek").addEventListener("change", ({ target }) => { seeking = false; ask({ seek: Number(target.value) }); });
control("speed").addEventListener("change", ({ target }) => { ask({ speed: Number(target.value) }); target.blur(); });
control("again").addEventListener("change", ({ target }) => ask({ loop: target.checked }));
control("estimator").addEventListener("change", ({ target }) => {
  chosen = target.value === "" ? null : Number(target.value);
  ask({ estimator: chosen });
  show(new Set(["parameters"]));
});
control("window").addEventListener("change", ({ target }) => {
  settings.window_s = Number(target.value);
  show(new Set(Object.keys(held)));
});
// A curve that is hidden stretches no axis.
function toggle(key) {
  const { plot, curve } = key.dataset;
  if (!hidden.delete(curve)) hidden.add(curve);
  key.setAttribute("aria-pressed", !hidden.has(curve));
  for (const one of model(plot).renderers) if (one.name === curve) one.visible = !hidden.has(curve);
  show(new Set(Object.keys(held)));
}
for (const key of document.querySelectorAll("button.key")) {
  if (key.getAttribute("aria-pressed") === "false") hidden.add(key.dataset.curve);
  key.addEventListener("click", () => toggle(key));
}
document.getElementById("pause").addEventListener("click", pause);
document.getElementById("theme").addEventListener("click", theme);
document.addEventListener("visibilitychange", attend);
document.addEventListener("keydown", (event) => {
  if (["BUTTON", "SELECT", "INPUT"].includes(event.target.tagName)) return;
  if (event.key === " ") { event.preventDefault(); pause(); }
  if (event.key === "t") theme();
});

function begin() {
  if (!Bokeh.documents.length) { setTimeout(begin, 20); return; }
  attend();
}
begin();
