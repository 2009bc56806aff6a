// Shows the figures of a page on the ground that the reader prefers, and answers to its buttons.
"use strict";
const given = document.getElementById("figures").textContent;
const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");

// Every colour of a figure stands in its JSON as `"#RRGGBB"`: on a dark ground it is another one.
function dressed(text, dark) {
  const colours = JSON.parse(given).dark;
  return dark ? text.replace(/"#[0-9A-Fa-f]{6}"/g, (one) => `"${colours[one.slice(1, -1)] ?? one.slice(1, -1)}"`) : text;
}

async function show() {
  delete document.documentElement.dataset.shown;
  for (const place of document.querySelectorAll(".screen > div")) place.replaceChildren();
  const { documents, items } = JSON.parse(dressed(given, prefersDark.matches));
  await Bokeh.embed.embed_items(documents, items);
  for (const key of document.querySelectorAll("button.key[aria-pressed=false]")) hide(key);
  document.documentElement.dataset.shown = "true";
}

const figure = (button) => button.closest("figure");
const plots = (button) => Bokeh.documents.at(-1).roots().filter(
  (plot) => plot.name.replace(/-[^-]*$/, "") === figure(button).dataset.chart);

function hide(key) {
  const visible = key.getAttribute("aria-pressed") === "true";
  for (const plot of plots(key)) {
    for (const one of plot.renderers) if (one.name === key.dataset.curve) one.visible = visible;
  }
}

// The rows of all sources, ordered by x: a blank where a source has no row there.
function table(button) {
  const sources = new Set(plots(button).flatMap((plot) => plot.renderers)
    .filter((one) => one.name !== null).map((one) => one.data_source));
  const header = ["x"], rows = new Map();
  for (const { data, tags } of sources) {
    tags[0].forEach((label, place) => {
      const column = header.push(`"${label}"`) - 1, values = data[`y${place}`];
      data.x.forEach((x, row) => {
        if (!rows.has(x)) rows.set(x, []);
        if (Number.isFinite(values[row])) rows.get(x)[column] = values[row];
      });
    });
  }
  const ordered = [...rows].sort(([a], [b]) => a - b);
  const line = (x, row) => [x, ...header.slice(1).map((_, place) => row[place + 1] ?? "")].join(",");
  return [header.join(","), ...ordered.map(([x, row]) => line(x, row))].join("\n") + "\n";
}

const saved = {
  csv: (button) => [table(button), "text/csv"],
  svg: (button) => [figure(button).querySelector(".paper svg").outerHTML, "image/svg+xml"],
};

document.addEventListener("click", ({ target }) => {
  const button = target.closest("button");
  if (button?.classList.contains("key")) {
    button.setAttribute("aria-pressed", button.getAttribute("aria-pressed") !== "true");
    hide(button);
  }
  if (button?.dataset.save) {
    const [text, type] = saved[button.dataset.save](button), link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type }));
    link.download = `${figure(button).dataset.chart}.${button.dataset.save}`;
    link.click();
  }
});
prefersDark.addEventListener("change", show);
show();

// A heading of a table sorts its rows: numbers by size, the rest by their words.
for (const heading of document.querySelectorAll("table.sortable th button")) {
  heading.addEventListener("click", () => {
    const cell = heading.parentElement, body = cell.closest("table").tBodies[0];
    const up = cell.getAttribute("aria-sort") !== "ascending", place = cell.cellIndex;
    const key = (row) => row.cells[place].dataset.sort, sign = up ? 1 : -1;
    const order = (a, b) => sign * (a - b) || sign * String(a).localeCompare(String(b));
    for (const one of cell.parentElement.cells) one.removeAttribute("aria-sort");
    cell.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...[...body.rows].sort((a, b) => order(key(a), key(b))));
  });
}
