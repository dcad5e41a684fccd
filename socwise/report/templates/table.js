"use strict";
// Tables that are sorted by a click on a heading and filtered by words. Without a script they are as they were.
(() => {
  const words = (text) => text.toLowerCase().split(/\s+/).filter(Boolean);
  const valueOf = (row, column) => {
    const cell = row.cells[column];
    if (!cell) return null;
    const text = cell.dataset.v ?? cell.textContent.trim();
    if (text === "" || text === "n/a" || text === "\u2013") return null;
    const number = Number(text.replace("\u2212", "-"));
    return Number.isNaN(number) ? text.toLowerCase() : number;
  };
  const compare = (a, b) => {
    if (a === null || b === null) return (a === null) - (b === null);
    if (typeof a === "number" && typeof b === "number") return a - b;
    return String(a).localeCompare(String(b), "en", { numeric: true });
  };

  function sortable(table) {
    const heads = [...table.tHead.rows[table.tHead.rows.length - 1].cells];
    const rows = [...table.tBodies].flatMap((body) => [...body.rows]).filter((row) => !row.classList.contains("group"));
    const homes = rows.map((row) => row.parentNode);
    let by = -1;
    let descending = false;

    function arrange() {
      const order = rows.map((row, place) => ({ row, place, value: by < 0 ? null : valueOf(row, by) }));
      if (by >= 0) {
        order.sort((a, b) => {
          if (a.value === null || b.value === null) return compare(a.value, b.value) || a.place - b.place;
          return (descending ? -1 : 1) * compare(a.value, b.value) || a.place - b.place;
        });
      }
      for (const { row, place } of order) (by < 0 ? homes[place] : table.tBodies[0]).append(row);
      table.classList.toggle("sorted", by >= 0);
      heads.forEach((head, column) => head.setAttribute("aria-sort",
        column !== by ? "none" : descending ? "descending" : "ascending"));
    }

    heads.forEach((head, column) => {
      if (!head.textContent.trim() && !head.dataset.sort) return;
      const button = document.createElement("button");
      button.type = "button";
      button.className = "sort";
      button.title = "Sort by this column; a third time restores the order";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        if (by !== column) { by = column; descending = false; }
        else if (!descending) descending = true;
        else { by = -1; descending = false; }
        arrange();
      });
    });
  }

  function filterable(input) {
    const table = document.getElementById(input.dataset.filter);
    const rows = [...table.tBodies].flatMap((body) => [...body.rows]);
    const groups = rows.filter((row) => row.classList.contains("group"));
    const cases = rows.filter((row) => !row.classList.contains("group"));
    const texts = cases.map((row) => row.textContent.toLowerCase());
    const bodies = cases.map((row) => row.parentNode);
    const count = document.getElementById(`${input.dataset.filter}-count`);

    function show() {
      const wanted = words(input.value);
      const seen = new Set();
      let shown = 0;
      cases.forEach((row, place) => {
        row.hidden = row.dataset.off === "1" || !wanted.every((word) => texts[place].includes(word));
        if (!row.hidden) { shown += 1; seen.add(bodies[place]); }
      });
      groups.forEach((row) => { row.hidden = !seen.has(row.parentNode); });
      if (count) count.textContent = `${shown} of ${cases.length}`;
    }
    input.addEventListener("input", show);
    table.addEventListener("refilter", show);
    show();
  }

  for (const table of document.querySelectorAll("table[data-sortable]")) sortable(table);
  for (const input of document.querySelectorAll("input[data-filter]")) filterable(input);

  const closed = [];
  window.addEventListener("beforeprint", () => {
    for (const one of document.querySelectorAll("details.printed:not([open])")) { one.open = true; closed.push(one); }
  });
  window.addEventListener("afterprint", () => { while (closed.length) closed.pop().open = false; });
})();
