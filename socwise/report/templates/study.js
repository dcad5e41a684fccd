"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const darkGround = window.matchMedia("(prefers-color-scheme: dark)");
  const byId = (id) => document.getElementById(id);
  const PAPER_PX = 680;
  const NARROW_PX = 600;
  const NONE = "";
  const HOLLOW_PX = 9;
  let printing = false;

  const WHAT = {
    loss: { label: "loss of certainty equivalence [%]", title: "Loss of certainty equivalence" },
    fuel: { label: "more fuel with certainty equivalence [%]", title: "Fuel that certainty equivalence burns more" },
    outside: { label: "time outside the SOC window [%]", title: "Time outside the SOC window, certainty equivalence" },
  };
  const config = {
    responsive: true, displaylogo: false, showTips: false,
    displayModeBar: matchMedia("(hover: hover)").matches ? "hover" : false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
  };
  const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const dark = () => darkGround.matches && !printing;
  const narrow = () => !printing && window.innerWidth < NARROW_PX;
  const inks = () => dark()
    ? { ink: "#e6e8eb", soft: "#a3abb5", line: "#363d46", ground: "#2a3037", low: "#56b4e9", high: "#ff8a3d" }
    : { ink: "#1c1e21", soft: "#5a6068", line: "#dfe2e6", ground: "#f5f6f8", low: "#0072b2", high: "#d55e00" };
  const COLORS = ["#0072B2", "#D55E00", "#009E73", "#B5609A", "#8C6D00", "#56B4E9", "#4B3FA0", "#777777"];
  const DARK_COLORS = ["#56B4E9", "#FF8A3D", "#3CCFA4", "#E79BCB", "#F0E442", "#9CC6E0", "#A99BFF", "#BBBBBB"];

  // Linear within 1 %, logarithmic beyond, on both sides of zero.
  const bend = (value) => Math.sign(value) * (Math.abs(value) <= 1 ? Math.abs(value) : 1 + Math.log10(Math.abs(value)));
  const TICKS = [-1000, -300, -100, -30, -10, -3, -1, 0, 1, 3, 10, 30, 100, 300, 1000, 3000, 10000];
  const bentTicks = (low, high) => {
    const shown = TICKS.filter((tick) => bend(tick) >= low - 0.05 && bend(tick) <= high + 0.05);
    return { tickvals: shown.map(bend), ticktext: shown.map((tick) => String(tick).replace("-", "\u2212")) };
  };
  const text = (value) => {
    const size = Math.abs(value);
    return value.toFixed(size >= 10 ? 0 : size >= 1 ? 1 : 2).replace("-", "\u2212").replace(/^\u2212(0\.?0*)$/, "$1");
  };
  const mix = (from, to, share) => {
    const part = (hex, k) => parseInt(hex.slice(1 + 2 * k, 3 + 2 * k), 16);
    const both = [0, 1, 2].map((k) => Math.round(part(from, k) + share * (part(to, k) - part(from, k))));
    return `rgb(${both.join(",")})`;
  };

  const sure = (values) => values[1] !== null && values[2] !== null && (values[1] > 0 || values[2] < 0);
  const isMeasured = (one) => one[byId("what").value] !== null;
  const measured = (one) => one[byId("what").value];
  const facetOf = (place) => byId(`facet-${place}`);
  const shown = () => data.cases.filter((one) => data.factors.every((factor, place) => {
    const facet = facetOf(place);
    return !facet || facet.value === NONE || String(one.factors[place]) === facet.value;
  }));
  const described = (one) => data.factors.map((factor, place) =>
    `${escaped(factor.label)}: ${one.factors[place] === null ? "n/a" : escaped(factor.values[one.factors[place]])}`).join("<br>");
  const explained = (one) => {
    const values = measured(one);
    const interval = values[1] === null ? "" : ` (${text(values[1])} to ${text(values[2])})`;
    return `case ${one.number}<br>${described(one)}<br><b>${text(values[0])} %</b>${interval}`;
  };

  function baseLayout(height) {
    return {
      height, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest",
      width: printing ? PAPER_PX : undefined, autosize: !printing,
      font: { family: "system-ui, sans-serif", size: 12, color: inks().ink },
      margin: { l: 60, r: 16, t: 16, b: 48 }, dragmode: narrow() ? false : "zoom", hoverlabel: { font: { size: 12 } },
      legend: { orientation: "h", x: 0, y: 1.02, xanchor: "left", yanchor: "bottom" },
    };
  }
  const axis = (title, more) => Object.assign({
    title: { text: escaped(title), standoff: 8 }, gridcolor: inks().line, linecolor: inks().soft,
    zerolinecolor: inks().soft, ticks: "outside", tickcolor: inks().soft, automargin: true,
  }, more);
  const placed = (factor, more) => factor.few
    ? axis(factor.label, { tickvals: factor.values.map((_, k) => k), ticktext: factor.values.map(shortened),
      range: [-0.5, factor.values.length - 0.5], showgrid: false, zeroline: false, ...more })
    : axis(factor.label, { type: spansDecades(factor) ? "log" : "linear", zeroline: false, ...more });
  const shortened = (value) => escaped(value.length > 18 ? `${value.slice(0, 17)}\u2026` : value);
  const spansDecades = (factor) => factor.numbers[0] > 0
    && factor.numbers[factor.numbers.length - 1] > 20 * factor.numbers[0];
  const position = (factor, place) => (factor.few ? place : factor.numbers[place]);

  function shades(values) {
    const tone = inks();
    const low = Math.min(0, ...values.map(bend));
    const high = Math.max(0.5, ...values.map(bend));
    const most = Math.max(high, -low);
    const zero = -low / (high - low);
    const scale = [[0, mix(tone.ground, tone.low, -low / most)]];
    if (zero > 0) scale.push([zero, mix(tone.ground, tone.low, 0)]);
    scale.push([1, mix(tone.ground, tone.high, high / most)]);
    return { cmin: low, cmax: high, colorscale: scale,
      colorbar: { ...bentTicks(low, high), title: { text: "%", side: "right" }, thickness: 12, outlinewidth: 0 } };
  }

  const gather = {
    median: (values) => { const s = [...values].sort((a, b) => a - b); const m = s.length >> 1;
      return s.length % 2 ? s[m] : 0.5 * (s[m - 1] + s[m]); },
    max: (values) => Math.max(...values),
    min: (values) => Math.min(...values),
  };

  function cellsOf(cases, x, y) {
    const cells = new Map();
    for (const one of cases) {
      const key = `${one.factors[x]} ${one.factors[y]}`;
      if (!cells.has(key)) cells.set(key, { x: one.factors[x], y: one.factors[y], cases: [] });
      cells.get(key).cases.push(one);
    }
    return [...cells.values()];
  }

  function heatMap(cells, xf, yf) {
    const how = gather[byId("several").value];
    for (const cell of cells) {
      cell.value = how(cell.cases.map((one) => measured(one)[0]));
      cell.sure = cell.cases.filter((one) => sure(measured(one))).length;
      cell.judged = cell.cases.some((one) => measured(one)[1] !== null);
    }
    const tone = inks();
    const grid = yf.values.map(() => xf.values.map(() => null));
    for (const cell of cells) grid[cell.y][cell.x] = cell;
    const level = shades(cells.map((cell) => cell.value));
    const roomy = !narrow() || xf.values.length <= 5;
    const label = (cell) => {
      const number = text(cell.value);
      return cell.judged && cell.sure === 0 ? `(${number})` : number;
    };
    const hover = (cell) => `${escaped(xf.label)}: ${escaped(xf.values[cell.x])}<br>`
      + `${escaped(yf.label)}: ${escaped(yf.values[cell.y])}<br>`
      + (cell.cases.length === 1 ? explained(cell.cases[0])
        : `<b>${text(cell.value)} %</b>, ${byId("several").selectedOptions[0].text} of ${cell.cases.length} cases<br>`
          + (cell.judged ? `${cell.sure} of them told from zero` : ""));
    const unsure = cells.filter((cell) => cell.judged && cell.sure === 0);
    return [
      { type: "heatmap", z: grid.map((row) => row.map((cell) => (cell ? bend(cell.value) : null))),
        zmin: level.cmin, zmax: level.cmax, colorscale: level.colorscale, colorbar: level.colorbar, xgap: 2, ygap: 2,
        text: grid.map((row) => row.map((cell) => (cell ? hover(cell) : ""))), hovertemplate: "%{text}<extra></extra>" },
      { type: "scatter", mode: "markers", x: unsure.map((cell) => cell.x), y: unsure.map((cell) => cell.y),
        hoverinfo: "skip", showlegend: false,
        marker: { symbol: "x-thin-open", size: narrow() ? 26 : 34, opacity: 0.35, line: { width: 1.5, color: tone.ink } } },
      { type: "scatter", mode: "text", x: cells.map((cell) => cell.x), y: cells.map((cell) => cell.y),
        text: roomy ? cells.map(label) : cells.map(() => ""), hoverinfo: "skip", showlegend: false,
        textfont: { size: narrow() ? 10 : 12,
          color: cells.map((cell) => (dark() && bend(cell.value) > 0.55 * level.cmax ? "#15181c" : tone.ink)) } },
    ];
  }

  function pointMap(cases, x, y) {
    const [xf, yf] = [data.factors[x], data.factors[y]];
    const level = shades(cases.map((one) => measured(one)[0]));
    const dots = (part, symbol, name) => ({
      type: "scatter", mode: "markers", name,
      x: part.map((one) => position(xf, one.factors[x])), y: part.map((one) => position(yf, one.factors[y])),
      marker: { symbol, size: HOLLOW_PX, color: part.map((one) => bend(measured(one)[0])), cmin: level.cmin, cmax: level.cmax,
        colorscale: level.colorscale, colorbar: level.colorbar, showscale: symbol === "circle",
        line: { width: symbol === "circle" ? 1 : 2, color: symbol === "circle" ? inks().soft : undefined } },
      text: part.map(explained), hovertemplate: "%{text}<extra></extra>",
    });
    const told = cases.filter((one) => measured(one)[1] === null || sure(measured(one)));
    const rest = cases.filter((one) => !told.includes(one));
    return [dots(told, "circle", "told from zero"), dots(rest, "circle-open", "like zero")];
  }

  function drawMap() {
    const x = Number(byId("map-x").value);
    const y = Number(byId("map-y").value);
    const [xf, yf] = [data.factors[x], data.factors[y]];
    const cases = shown().filter((one) => isMeasured(one) && one.factors[x] !== null && one.factors[y] !== null);
    const cells = xf.few && yf.few;
    byId("several").parentNode.hidden = !cells;
    const wanted = WHAT[byId("what").value];
    const layout = baseLayout(cells ? Math.min(640, 150 + 62 * yf.values.length) : 480);
    layout.xaxis = placed(xf);
    layout.yaxis = placed(yf);
    layout.showlegend = !cells;
    const traces = !cases.length ? [] : cells ? heatMap(cellsOf(cases, x, y), xf, yf) : pointMap(cases, x, y);
    byId("map-title").textContent = `${wanted.title}, ${cases.length} ${cases.length === 1 ? "case" : "cases"}`;
    byId("map-note").textContent = byId("what").value === "outside"
      ? "Colours are linear within 1 % and logarithmic beyond."
      : cells
        ? "Crossed out and in brackets: no case of the cell can be told from zero. Colours are linear within 1 % and "
          + "logarithmic beyond; blue is where certainty equivalence does better."
        : "Hollow: cannot be told from zero. Colours are linear within 1 % and logarithmic beyond; blue is where "
          + "certainty equivalence does better.";
    Plotly.react(byId("map-plot"), traces, layout, config);
  }

  function drawProfile() {
    const x = Number(byId("profile-x").value);
    const by = byId("profile-color").value === NONE ? -1 : Number(byId("profile-color").value);
    const xf = data.factors[x];
    const cases = shown().filter((one) => isMeasured(one) && one.factors[x] !== null);
    const groups = by < 0 ? [null] : data.factors[by].values.map((_, place) => place);
    const palette = dark() ? DARK_COLORS : COLORS;
    const traces = [];
    groups.forEach((group, place) => {
      const part = group === null ? [...cases] : cases.filter((one) => one.factors[by] === group);
      if (!part.length) return;
      // The legend takes the look of the first point.
      part.sort((a, b) => sure(measured(b)) - sure(measured(a)) || a.number - b.number);
      const shift = xf.few ? (place - (groups.length - 1) / 2) * 0.7 / groups.length : 0;
      const spread = xf.few ? 0.5 / groups.length : 0;
      const color = palette[place % palette.length];
      const level = part.map((one) => bend(measured(one)[0]));
      traces.push({
        type: "scatter", mode: "markers", name: group === null ? "cases" : escaped(data.factors[by].values[group]),
        x: part.map((one, k) => position(xf, one.factors[x]) + shift + spread * ((k + 0.5) / part.length - 0.5)), y: level,
        marker: { color, size: 7, symbol: part.map((one) => (measured(one)[1] === null || sure(measured(one)) ? "circle" : "circle-open")) },
        error_y: { type: "data", symmetric: false, thickness: 1, width: 0, color,
          array: part.map((one, k) => (measured(one)[2] === null ? 0 : bend(measured(one)[2]) - level[k])),
          arrayminus: part.map((one, k) => (measured(one)[1] === null ? 0 : level[k] - bend(measured(one)[1]))) },
        text: part.map(explained), hovertemplate: "%{text}<extra></extra>",
      });
    });
    const ends = cases.flatMap((one) => measured(one).filter((value) => value !== null).map(bend));
    const [low, high] = [Math.min(-0.2, ...ends), Math.max(1, ...ends)];
    const layout = baseLayout(440);
    layout.showlegend = by >= 0;
    layout.xaxis = placed(xf);
    layout.yaxis = axis(WHAT[byId("what").value].label, { ...bentTicks(low, high), range: [low - 0.1, high + 0.15],
      zeroline: true, zerolinewidth: 2 });
    byId("profile-title").textContent = `${WHAT[byId("what").value].title} over ${xf.label}`;
    Plotly.react(byId("profile-plot"), traces, layout, config);
  }

  function sieveTable() {
    const numbers = new Set(shown().map((one) => one.number));
    const table = byId("study-cases");
    for (const row of table.querySelectorAll("tbody tr")) {
      row.dataset.off = numbers.has(data.cases[Number(row.dataset.case)].number) ? "" : "1";
    }
    table.dispatchEvent(new Event("refilter"));
  }

  const option = ([value, label]) => new Option(label, value);
  function choices() {
    const every = data.factors.map((factor, place) => [String(place), factor.label]);
    data.factors.forEach((factor, place) => {
      if (!factor.few) return;
      const label = document.createElement("label");
      const select = document.createElement("select");
      select.id = `facet-${place}`;
      select.append(...[[NONE, "all"], ...factor.values.map((value, k) => [String(k), value])].map(option));
      label.append(`${factor.label} `, select);
      byId("facets").append(label);
    });
    // What decides most goes on the axes, numbers before names.
    const order = [...new Set([...data.deciding, ...every.map(([p]) => Number(p))])];
    const [first, second] = [...order.filter((p) => data.factors[p].numeric), ...order.filter((p) => !data.factors[p].numeric)];
    byId("map-x").append(...every.map(option));
    byId("map-y").append(...every.map(option));
    byId("profile-x").append(...every.map(option));
    byId("profile-color").append(...[[NONE, "none"], ...every.filter(([p]) => data.factors[p].few)].map(option));
    byId("what").append(...Object.entries(WHAT).filter(([name]) => data.cases.some((one) => one[name] !== null))
      .map(([name, { label }]) => new Option(label.replace(" [%]", ""), name)));
    byId("map-x").value = String(first);
    byId("map-y").value = String(second ?? first);
    byId("profile-x").value = String(first);
    const colored = every.find(([p]) => data.factors[p].name === "concept")
      ?? every.find(([p]) => data.factors[p].few && Number(p) !== first);
    byId("profile-color").value = colored ? colored[0] : NONE;
  }

  function drawAll() {
    if (data.factors.length > 1) drawMap();
    drawProfile();
  }

  if (!data.factors.length || !data.cases.some((one) => one.loss)) {
    byId("pictures").hidden = true;
    return;
  }
  choices();
  if (data.factors.length < 2) {
    for (const id of ["map-x", "map-y", "several"]) byId(id).parentNode.hidden = true;
    for (const id of ["map-title", "map-plot", "map-note", "choice"]) byId(id).hidden = true;
  }
  drawAll();
  for (const id of ["map-x", "map-y"]) {
    byId(id).addEventListener("change", () => {
      const other = byId(id === "map-x" ? "map-y" : "map-x");
      if (other.value === byId(id).value) other.selectedIndex = (other.selectedIndex + 1) % other.length;
      drawMap();
    });
  }
  byId("several").addEventListener("change", drawMap);
  byId("what").addEventListener("change", drawAll);
  for (const id of ["profile-x", "profile-color"]) byId(id).addEventListener("change", drawProfile);
  byId("facets").addEventListener("change", () => { drawAll(); sieveTable(); });
  darkGround.addEventListener("change", drawAll);
  let wasNarrow = narrow();
  window.addEventListener("resize", () => {
    if (narrow() !== wasNarrow) { wasNarrow = narrow(); drawAll(); }
  });
  window.addEventListener("beforeprint", () => { printing = true; drawAll(); });
  window.addEventListener("afterprint", () => { printing = false; drawAll(); });
})();
