// Draws the frames that the server sends. It holds the rows itself and moves the axes itself, so
// that nothing goes back to the server; frames that wait are drawn together.
"use strict";
// Whenever bokeh paints it writes the style sheets of its axes anew, though they are as they were, and
// the browser works out all styles again, six times a frame: a sheet that stays the same is left.
const text = Object.getOwnPropertyDescriptor(Node.prototype, "textContent");
Object.defineProperty(HTMLStyleElement.prototype, "textContent", {
  get() { return text.get.call(this); },
  set(css) { if (css !== text.get.call(this)) text.set.call(this, css); },
});
const held = {}, least = {}, models = {};
const model = (name) => (models[name] ??= Bokeh.documents[0].get_model_by_name(name));
const waiting = [];
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
  for (const [id, html] of Object.entries(frame.words)) document.getElementById(id).innerHTML = html;
  for (const [name, told] of Object.entries(frame.plots)) {
    const plot = model(name);
    if ("label" in told) plot.left[0].axis_label = told.label;
    if ("title" in told) plot.title.text = told.title;
    if ("least" in told) least[name] = told.least;
    if ("visible" in told) plot.visible = told.visible;
  }
  for (const [name, { replace, keep, columns }] of Object.entries(frame.sources)) {
    const rows = replace ? {} : held[name];
    for (const [column, text] of Object.entries(columns)) {
      rows[column] = joined(rows[column] ?? new Float64Array(), decoded(text), keep);
    }
    held[name] = rows;
    touched.add(name);
  }
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
// What does not move is shown as still: an axis is never less high than its least.
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

// What an axis must hold: the newest value, and what is held; without that every value.
function extent(columns, values) {
  const found = limits(columns);
  return found ? limits([found, values.slice(-1)]) : limits([values]);
}

function show(touched) {
  for (const name of touched) model(name).data = name === "parameters" ? closed(held[name]) : { ...held[name] };
  const end = held.slave?.t.at(-1);
  for (const [name, [shown, value]] of Object.entries(settings.plots)) {
    const plot = model(name);
    const scrolls = name !== "plot_correlation";
    if (!shown.some(([source]) => touched.has(source))) continue;
    const rows = ([source, column]) => held[source]?.[column] ?? [];
    const found = extent(shown.map(rows), value ? rows(value) : []);
    if (found) fit(plot.y_range, found, least[name] ?? 0);
    if (scrolls && end !== undefined) {
      const start = Math.max(0, end - settings.window_s);
      plot.x_range.setv({ start, end: start + settings.window_s });
    }
    if (!scrolls && held.correlation.lag.length) {
      const { lag, width } = held.correlation;
      plot.x_range.setv({ start: lag[0] - width[0], end: lag.at(-1) + width[0] });
    }
  }
}

function paint() {
  const touched = new Set();
  for (const frame of waiting.splice(0)) take(frame, touched);
  show(touched);
  drawn += 1;
}

function listen() {
  socket = new WebSocket(`${location.origin.replace("http", "ws")}/frames`);
  const mine = socket;
  socket.onopen = () => { if (lost) location.reload(); };
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
  const looks = !paused && !document.hidden;
  if (looks && socket === null) listen();
  if (!looks && socket !== null) {
    const line = socket;
    socket = null;
    line.close();
  }
}

function pause() {
  const button = document.getElementById("pause");
  paused = !paused;
  button.setAttribute("aria-pressed", paused);
  button.textContent = paused ? "Go on" : "Pause";
  attend();
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
document.getElementById("pause").addEventListener("click", pause);
document.getElementById("theme").addEventListener("click", theme);
document.addEventListener("visibilitychange", attend);
document.addEventListener("keydown", (event) => {
  if (event.target.tagName === "BUTTON" && event.key === " ") return;
  if (event.key === " ") { event.preventDefault(); pause(); }
  if (event.key === "t") theme();
});

function begin() {
  if (!Bokeh.documents.length) { setTimeout(begin, 20); return; }
  attend();
}
begin();
