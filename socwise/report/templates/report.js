"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const darkGround = window.matchMedia("(prefers-color-scheme: dark)");
  let printing = false;

  const PAPER_PX = 680;
  const NOTHING = " ";
  const NARROW_PX = 600;
  const ROW_PX = 26;
  const config = {
    responsive: true, displaylogo: false, showTips: false,
    // Without a pointer that hovers, the bar would stay on top of the legend.
    displayModeBar: matchMedia("(hover: hover)").matches ? "hover" : false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
  };

  const unique = (items) => [...new Set(items)];
  const byId = (id) => document.getElementById(id);
  const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const dark = () => darkGround.matches && !printing;
  const narrow = () => !printing && window.innerWidth < NARROW_PX;
  const inks = () => dark()
    ? { ink: "#e6e8eb", soft: "#a3abb5", line: "#363d46", band: "rgba(200,205,212,0.22)", altitude: "#d8b94a" }
    : { ink: "#1c1e21", soft: "#5a6068", line: "#dfe2e6", band: "rgba(90,96,104,0.22)", altitude: "#8c6d00" };
  const color = (policy) => data.policies[policy][dark() ? "dark" : "light"];
  const label = (policy) => escaped(data.policies[policy].label);
  const faded = (hex) => hex + "59";
  const show = (value, digits) => value.toFixed(digits).replace("-", "\u2212");

  function unpack(packed) {
    const bytes = Uint8Array.from(atob(packed.data), (character) => character.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Array.from({ length: bytes.length / 2 },
      (_, k) => packed.low + packed.step * view.getUint16(2 * k, true));
  }

  function baseLayout(height) {
    const tone = inks();
    return {
      height, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest",
      width: printing ? PAPER_PX : undefined, autosize: !printing,
      font: { family: "system-ui, sans-serif", size: 12, color: tone.ink },
      margin: { l: 60, r: 16, t: 12, b: 44 }, dragmode: narrow() ? false : "zoom",
      hoverlabel: { font: { size: 12 } },
      legend: { orientation: "h", x: 0, y: 1.02, xanchor: "left", yanchor: "bottom", traceorder: "normal" },
    };
  }

  const axis = (title, more) => Object.assign({
    title: { text: title, standoff: 8 }, gridcolor: inks().line, linecolor: inks().soft, zerolinecolor: inks().soft,
    ticks: "outside", tickcolor: inks().soft, automargin: true,
  }, more);

  function panels(holder, concepts, draw) {
    const id = (concept) => `${holder}-${Object.keys(data.concepts).indexOf(concept)}`;
    // All boxes before any plot: a plot takes the width that it finds.
    for (const concept of concepts.filter((one) => !byId(id(one)))) {
      const box = document.createElement("div");
      const title = document.createElement("h3");
      const plot = document.createElement("div");
      title.textContent = data.concepts[concept];
      plot.id = id(concept);
      plot.className = "plot";
      box.append(title, plot);
      byId(holder).append(box);
    }
    for (const concept of concepts) draw(byId(id(concept)), concept);
  }

  function drawDifferences(plot, concept) {
    const entries = data.differences.filter((entry) => entry.concept === concept);
    const mus = unique(entries.map((entry) => entry.mu)).sort((a, b) => a - b);
    const pairs = unique(entries.map((entry) => `${entry.policy}\n${entry.versus}`));
    const traces = pairs.map((pair, place) => {
      const mine = entries.filter((entry) => `${entry.policy}\n${entry.versus}` === pair);
      const { policy, versus } = mine[0];
      const offset = (place - (pairs.length - 1) / 2) * 0.6 / pairs.length;
      const name = policy === "stochastic" ? `less ${label(versus)}` : `${label(policy)} less ${label(versus)}`;
      return {
        type: "scatter", mode: "markers", name, marker: { size: 9, color: color(versus) },
        x: mine.map((entry) => entry.mean), y: mine.map((entry) => mus.indexOf(entry.mu) + offset),
        error_x: {
          type: "data", symmetric: false, thickness: 1.6, width: 5, color: color(versus),
          array: mine.map((entry) => (entry.high === null ? 0 : entry.high - entry.mean)),
          arrayminus: mine.map((entry) => (entry.low === null ? 0 : entry.mean - entry.low)),
        },
        text: mine.map((entry) => `${label(policy)} less ${label(versus)}, \u03bc = ${entry.mu}<br>`
          + `${show(entry.mean, 4)} kg, `
          + (entry.low === null ? "no interval" : `95 %: ${show(entry.low, 4)} to ${show(entry.high, 4)} kg`)),
        hovertemplate: "%{text}<extra></extra>",
      };
    });
    const layout = baseLayout(110 + mus.length * (ROW_PX + 16 * pairs.length));
    layout.showlegend = true;
    layout.xaxis = axis("difference in realised cost [kg fuel]", { zeroline: true, zerolinewidth: 2, nticks: 6 });
    layout.yaxis = axis("", {
      tickvals: mus.map((_, row) => row), ticktext: mus.map((mu) => `\u03bc = ${mu}`),
      range: [mus.length - 0.5, -0.5], showgrid: false, zeroline: false,
    });
    Plotly.react(plot, traces, layout, config);
  }

  function drawCost(plot, concept) {
    const cases = data.cases.filter((one) => one.concept === concept);
    const mus = unique(cases.map((one) => one.mu)).sort((a, b) => a - b);
    const cut = data.cuts[concept];
    const rows = [];
    const annotations = [];
    let level = 0;
    for (const mu of mus) {
      annotations.push({
        text: `<b>\u03bc = ${mu}</b>`, x: 0, xref: "paper", xanchor: "left", y: level, yanchor: "middle",
        showarrow: false, font: { color: inks().ink },
      });
      level += 1;
      for (const one of cases.filter((other) => other.mu === mu)) rows.push({ one, level: level++ });
      level += 0.3;
    }
    for (const { one, level: at } of rows.filter((row) => cut !== null && row.one.cost_kg > cut)) {
      annotations.push({
        text: `<b>${show(one.cost_kg, 1)} \u2192</b>`, x: 1, xref: "paper", xanchor: "right", y: at,
        yanchor: "middle", showarrow: false, font: { color: inks().ink },
      });
    }
    const hover = rows.map(({ one }) => `${label(one.policy)}, \u03bc = ${one.mu}<br>`
      + `cost ${show(one.cost_kg, 4)}`
      + (one.half_width_kg === null ? "" : ` \u00b1 ${show(one.half_width_kg, 4)}`)
      + ` kg<br>fuel ${show(one.fuel_kg, 4)} kg<br>penalties ${show(one.extra_kg, 4)} kg`);
    const bar = { type: "bar", orientation: "h", y: rows.map((row) => row.level), width: 0.78,
      text: hover, textposition: "none", hovertemplate: "%{text}<extra></extra>" };
    const traces = [
      { ...bar, x: rows.map(({ one }) => one.fuel_kg),
        marker: { color: rows.map(({ one }) => color(one.policy)) } },
      { ...bar, x: rows.map(({ one }) => one.extra_kg),
        base: rows.map(({ one }) => (one.extra_kg >= 0 ? one.fuel_kg : 0)),
        marker: { color: rows.map(({ one }) => faded(color(one.policy))),
          line: { width: 1, color: rows.map(({ one }) => color(one.policy)) } } },
      { type: "scatter", mode: "markers", x: rows.map(({ one }) => one.cost_kg), y: bar.y,
        marker: { size: 1, color: inks().ink }, hoverinfo: "skip",
        error_x: { type: "data", array: rows.map(({ one }) => one.half_width_kg ?? 0), thickness: 1.5, width: 5,
          color: inks().ink } },
    ];
    const layout = baseLayout(80 + level * ROW_PX);
    Object.assign(layout, { barmode: "overlay", showlegend: false, annotations });
    layout.xaxis = axis("realised cost [kg fuel]", { rangemode: "tozero", nticks: 6 });
    if (cut !== null) layout.xaxis.range = [0, cut];
    layout.yaxis = axis("", {
      tickvals: bar.y, ticktext: rows.map(({ one }) => escaped(data.policies[one.policy].short)),
      range: [level - 0.3, -0.6], showgrid: false, zeroline: false,
    });
    Plotly.react(plot, traces, layout, config);
  }

  const chosen = (id) => byId(id).value;
  const find = (policy) => data.cases.find((one) => one.concept === chosen("concept")
    && String(one.mu) === chosen("mu") && one.policy === policy);

  function fill(id, options, preferred) {
    const select = byId(id);
    const before = select.value;
    select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
    const values = options.map(([value]) => value);
    select.value = [before, preferred, values[0]].find((value) => values.includes(value));
  }

  function fillControls() {
    fill("concept", Object.entries(data.concepts));
    const inConcept = data.cases.filter((one) => one.concept === chosen("concept"));
    const mus = unique(inConcept.map((one) => one.mu)).sort((a, b) => a - b);
    fill("mu", mus.map((mu) => [String(mu), String(mu)]), String(mus[mus.length - 1]));
    const policies = inConcept.filter((one) => String(one.mu) === chosen("mu")).map((one) => one.policy);
    const options = policies.map((policy) => [policy, data.policies[policy].label]);
    fill("policy", options, "stochastic");
    const others = options.filter(([policy]) => policy !== chosen("policy"));
    fill("other", [...others, [NOTHING, "nothing"]], "certainty_equivalent");
    const count = find(chosen("policy")).traces.length;
    fill("realization", Array.from({ length: count }, (_, k) => [String(k), String(k + 1)]), "0");
  }

  function beliefTraces(one, time, tone) {
    const trace = one.traces[Number(chosen("realization"))];
    const estimate = unpack(trace.estimate);
    const spread = unpack(trace.spread);
    const sd = estimate.map((_, k) => spread[Math.floor(k / data.points_per_stretch)]);
    const line = { type: "scatter", mode: "lines", x: time, xaxis: "x", yaxis: "y" };
    const edge = { ...line, line: { width: 0 }, hoverinfo: "skip", legendgroup: "band" };
    return [
      { ...edge, y: estimate.map((value, k) => value - 2 * sd[k]), showlegend: false },
      { ...edge, y: estimate.map((value, k) => value + 2 * sd[k]), fill: "tonexty", fillcolor: tone.band,
        name: "estimate \u00b1 2\u221ap" },
      { ...line, y: estimate, line: { width: 1, color: tone.soft }, name: "estimate",
        hovertemplate: "%{y:.2f} %<extra>estimate</extra>" },
      { ...line, x: [time[0], time[time.length - 1], null, time[0], time[time.length - 1]],
        y: [one.window[0], one.window[0], null, one.window[1], one.window[1]],
        line: { width: 1, dash: "dash", color: tone.soft }, name: "window", hoverinfo: "skip" },
      { ...line, x: time, y: sd, yaxis: "y2", line: { width: 1.5, color: color(one.policy) }, showlegend: false,
        hovertemplate: `%{y:.2f} %<extra>\u221ap, ${label(one.policy)}</extra>` },
    ];
  }

  function operationTraces(one, time, first) {
    const trace = one.traces[Number(chosen("realization"))];
    const tint = color(one.policy);
    const name = label(one.policy);
    const line = { type: "scatter", mode: "lines", x: time, legendgroup: one.policy, showlegend: false };
    const engine = { x: [], y: [] };
    for (let k = 0; k < trace.engine.length; k += 2) {
      engine.x.push(trace.engine[k], trace.engine[k + 1], null);
      engine.y.push(first ? 1 : 0, first ? 1 : 0, null);
    }
    return [
      { ...line, y: unpack(trace.soc), yaxis: "y", showlegend: true, name: `true, ${name}`,
        line: { width: first ? 2 : 1.3, color: tint }, hovertemplate: `%{y:.2f} %<extra>true, ${name}</extra>` },
      { ...line, y: unpack(trace.current), yaxis: "y3", line: { width: 1, color: tint, shape: "hv" },
        opacity: first ? 1 : 0.75, hovertemplate: `%{y:.1f} A<extra>${name}</extra>` },
      { ...line, ...engine, yaxis: "y4", line: { width: 10, color: tint },
        hovertemplate: `engine on, %{x:.0f} s<extra>${name}</extra>` },
    ];
  }

  function drawTrajectory() {
    const tone = inks();
    const time = data.cycle.time_s;
    const main = find(chosen("policy"));
    const other = find(chosen("other"));
    const traces = beliefTraces(main, time, tone);
    if (other) traces.push(...operationTraces(other, time, false));
    traces.push(...operationTraces(main, time, true));
    const line = { type: "scatter", mode: "lines", x: time, showlegend: false };
    traces.push(
      { ...line, y: data.cycle.speed_kmh, yaxis: "y5", line: { width: 1, color: tone.ink },
        hovertemplate: "%{y:.0f} km/h<extra></extra>" },
      { ...line, y: data.cycle.altitude_m, yaxis: "y6", line: { width: 1.5, dash: "dash", color: tone.altitude },
        hovertemplate: "%{y:.0f} m<extra>altitude</extra>" },
    );
    const layout = baseLayout(narrow() ? 860 : 920);
    layout.margin = { l: 62, r: 58, t: 12, b: 44 };
    layout.xaxis = axis("time [s]", { anchor: "y5", range: [0, data.cycle.duration_s], zeroline: false, nticks: 8 });
    layout.yaxis = axis("SOC [%]", { domain: [0.66, 1], zeroline: false });
    layout.yaxis2 = axis("\u221ap [%]", { domain: [0.52, 0.63], rangemode: "tozero", nticks: 4 });
    layout.yaxis3 = axis("current [A]", { domain: [0.29, 0.49], nticks: 6 });
    layout.yaxis4 = axis("engine", { domain: [0.2, 0.26], range: [-0.7, 1.7], showticklabels: false, ticks: "",
      showgrid: false, zeroline: false, fixedrange: true });
    layout.yaxis5 = axis("speed [km/h]", { domain: [0, 0.17], rangemode: "tozero", nticks: 4 });
    layout.yaxis6 = axis("altitude [m]", { overlaying: "y5", side: "right", tickmode: "auto", showgrid: false, zeroline: false, nticks: 4,
      title: { text: "altitude [m]", standoff: 4, font: { color: tone.altitude } }, tickfont: { color: tone.altitude } });
    byId("trajectory-title").textContent = `${data.concepts[main.concept]}, \u03bc = ${main.mu}, `
      + `${data.policies[main.policy].label}, realization ${Number(chosen("realization")) + 1} of ${main.realizations}`;
    Plotly.react(byId("trajectory-plot"), traces, layout, config);
  }

  function drawAll() {
    const concepts = Object.keys(data.concepts);
    const paired = concepts.filter((concept) => data.differences.some((entry) => entry.concept === concept));
    panels("differences-plots", paired, drawDifferences);
    panels("cost-plots", concepts, drawCost);
    drawTrajectory();
  }

  if (!data.differences.length) byId("differences-note").textContent = "No two policies were compared.";
  fillControls();
  drawAll();
  for (const id of ["concept", "mu", "policy", "other", "realization"]) {
    byId(id).addEventListener("change", () => { fillControls(); drawTrajectory(); });
  }
  darkGround.addEventListener("change", drawAll);
  let wasNarrow = narrow();
  window.addEventListener("resize", () => {
    if (narrow() !== wasNarrow) { wasNarrow = narrow(); drawAll(); }
  });
  window.addEventListener("beforeprint", () => { printing = true; drawAll(); });
  window.addEventListener("afterprint", () => { printing = false; drawAll(); });
})();
