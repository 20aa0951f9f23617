"use strict";
(function () {
  const css = getComputedStyle(document.documentElement);
  const color = (name) => css.getPropertyValue("--" + name).trim();
  const faint = (name) => color(name).replace("rgb(", "rgba(").replace(")", ",0.16)");
  const [ink, muted, rule, paper, shade] = ["ink", "muted", "rule", "paper", "shade"].map(color);
  const fingers = ["thumb", "index-finger", "middle-finger", "ring-finger", "little-finger"];
  // Of lines that are no fingers: the palette's without its yellow, too pale for a line.
  const series = [0, 1, 3, 4].map((finger) => color(fingers[finger])).concat(ink);

  // ---- How all figures look -------------------------------------------------------------------

  const font = {family: css.getPropertyValue("--font"), size: 12, color: ink};
  const hoverlabel = {bgcolor: ink, bordercolor: ink, align: "left", font: {...font, size: 13, color: paper}};

  function themedAxis(axis) {
    const look = {gridcolor: rule, zeroline: false, linecolor: rule, fixedrange: true, automargin: true};
    const title = axis.title?.text ? {font: {size: 12, color: muted}, ...axis.title} : undefined;
    return {...look, tickfont: {size: 11, color: muted}, ...axis, title};
  }

  function themed(layout) {
    const whole = {
      font, hoverlabel, paper_bgcolor: paper, plot_bgcolor: paper,
      showlegend: false, dragmode: false, hovermode: "closest",
      legend: {orientation: "h", y: 1.02, yanchor: "bottom", x: 0, xanchor: "left"},
      margin: {l: 48, r: 16, t: 30, b: 44}, xaxis: {}, yaxis: {},
      ...layout, template: {}, title: undefined,
    };
    for (const name of Object.keys(whole)) {
      if (/^[xy]axis\d*$/.test(name)) whole[name] = themedAxis(whole[name]);
    }
    return whole;
  }

  // ---- The piano roll -------------------------------------------------------------------------

  // Heights in pixels; the played bar, in rows of the keyboard, lies within the one that is due.
  const LEGIBLE_ROW = 13, LEAST_ROW = 9, MOST_HEIGHT = 560, PEDAL_HEIGHT = 44, GAP = 14;
  const DUE_HEIGHT = 0.92, PLAYED_HEIGHT = 0.46, LEAST_KEYS = 12, MIDDLE_C = 39, LAST_KEY = 87;
  const FIRST_VIEW = 24;  // s of a long piece
  const BEYOND = 0.1;  // s that can be seen before the beginning and after the end

  const solid = (fill) => ({color: fill, line: {width: 0}});
  const outlined = (fill, line, width) => ({color: fill, line: {width, color: line}});
  const patterned = (shape) => ({
    ...outlined(ink, ink, 1), pattern: {shape, bgcolor: paper, fgcolor: ink, size: 5, solidity: 0.45},
  });
  const markers = {
    hit: solid(color("sounding")), early: patterned("/"), late: patterned("\\"),
    again: patterned("."), wrong: solid(ink), pedal: solid(color("absent")),
    "not-reached": outlined(color("ground"), color("absent"), 1.5),
  };
  for (const finger of [...fingers, "any-finger"]) {
    markers["due-" + finger] = outlined(faint(finger), color(finger), 1.5);
  }

  const noteHover = (labels) => "<b>%{customdata[0]}</b>  %{customdata[1]}"
    + labels.map((label, i) => `<br>${label}: %{customdata[${i + 2}]}`).join("") + "<extra></extra>";

  function noteTrace(mark, bars, labels) {
    const common = {meta: mark, customdata: bars.texts, hovertemplate: noteHover(labels)};
    if (mark === "missed") {
      const cross = {symbol: "x-thin", size: 8, line: {width: 2, color: ink}};
      return {...common, type: "scatter", mode: "markers", x: bars.onset, y: bars.key, marker: cross};
    }
    const due = mark.startsWith("due-") || mark === "not-reached";
    return {
      ...common, type: "bar", orientation: "h", base: bars.onset, x: bars.length, y: bars.key,
      width: due ? DUE_HEIGHT : PLAYED_HEIGHT, marker: markers[mark],
    };
  }

  function pedalTrace(row, mark, text, spans) {
    return {
      type: "bar", orientation: "h", yaxis: "y2", width: 0.6, marker: markers[mark],
      meta: "pedal", name: text, y: spans.map(() => row),
      base: spans.map(([on]) => on), x: spans.map(([on, off]) => off - on),
      customdata: spans.map((span) => span.map((time) => time.toFixed(2))),
      hovertemplate: text + "<br>%{customdata[0]} to %{customdata[1]} s<extra></extra>",
    };
  }

  /** The lowest and the highest key to show: all these, and an octave at least. */
  function keyRange(keys) {
    const used = keys.length ? keys : [MIDDLE_C];
    const low = used.reduce((a, b) => Math.min(a, b)) - 2, high = used.reduce((a, b) => Math.max(a, b)) + 2;
    const missing = Math.max(0, LEAST_KEYS - (high - low));
    return [Math.max(low - Math.floor(missing / 2), 0), Math.min(high + Math.ceil(missing / 2), LAST_KEY)];
  }

  /** Shades for the rows of the black keys, and a line below each C. */
  function keyboardShapes(names) {
    const across = {xref: "paper", x0: 0, x1: 1, yref: "y", layer: "below"};
    return names.flatMap((name, key) => {
      const below = {...across, y0: key - 0.5};
      if (name.includes("♯")) return {...below, type: "rect", y1: key + 0.5, fillcolor: shade, line: {width: 0}};
      return name[0] === "C" ? {...below, type: "line", y1: key - 0.5, line: {color: rule, width: 1}} : [];
    });
  }

  function endLine(end) {
    return {
      type: "line", xref: "x", x0: end, x1: end, yref: "paper", y0: 0, y1: 1,
      line: {color: ink, width: 1.5, dash: "dot"},
      label: {text: "the episode ended", textposition: "end", font: {size: 11}},
    };
  }

  function pianoRoll({bars, labels, pedal, keys, duration, end}) {
    const traces = Object.entries(bars).map(([mark, of]) => noteTrace(mark, of, labels));
    traces.push(pedalTrace(1, "pedal", "pedal due", pedal.due));
    const played = "hit" in pedal;
    if (played) {
      traces.push(
        pedalTrace(0, "hit", "pedal down, as it should be", pedal.hit),
        pedalTrace(0, "wrong", "pedal down, not due", pedal.wrong),
      );
    }
    const [low, high] = keyRange(Object.values(bars).flatMap((of) => of.key));
    const rows = high - low + 1;
    const row = Math.max(LEAST_ROW, Math.min(2 * LEGIBLE_ROW, Math.floor(MOST_HEIGHT / rows)));
    const inner = rows * row + GAP + PEDAL_HEIGHT;
    const named = keys.map((name, key) => key).filter((key) => key >= low && key <= high
      && !keys[key].includes("♯") && (row >= LEGIBLE_ROW || keys[key][0] === "C"));
    const pedalShade = {
      type: "rect", layer: "below", xref: "paper", x0: 0, x1: 1, yref: "y2 domain", y0: 0, y1: 1,
      fillcolor: shade, line: {width: 0},
    };
    const [start, stop] = [-BEYOND, duration + BEYOND];
    return [traces, {
      height: inner + 52, margin: {l: 44, r: 12, t: 8, b: 44}, barmode: "overlay", dragmode: "pan",
      meta: {start, end: stop},
      shapes: [...keyboardShapes(keys), pedalShade, ...(end === null ? [] : [endLine(end)])],
      xaxis: {
        range: [start, Math.min(stop, FIRST_VIEW)], minallowed: start, maxallowed: stop,
        fixedrange: false, anchor: "y2", title: {text: "seconds"},
      },
      yaxis: {
        domain: [(PEDAL_HEIGHT + GAP) / inner, 1], range: [low - 0.5, high + 0.5], showgrid: false,
        tickvals: named, ticktext: named.map((key) => keys[key]),
      },
      yaxis2: {
        domain: [0, PEDAL_HEIGHT / inner], range: [played ? -0.6 : 0.4, 1.6], showgrid: false,
        tickvals: played ? [1, 0] : [1], ticktext: played ? ["pedal due", "pedal"] : ["pedal"],
      },
    }];
  }

  // ---- The other figures ----------------------------------------------------------------------

  function fingerUsage({finger, name, played, due}) {
    const places = [-5, -4, -3, -2, -1, 1, 2, 3, 4, 5], palette = finger.map((f) => fingers[f % 5]);
    const common = {type: "bar", x: places, customdata: name};
    const traces = due === null ? [] : [{
      ...common, y: due, width: 0.84, marker: outlined(palette.map(faint), palette.map(color), 2),
      hovertemplate: "%{customdata}: the fingering asks for %{y:.1f} %<extra></extra>", name: "due",
    }];
    if (played !== null) traces.push({
      ...common, y: played, width: 0.46, marker: {color: palette.map(color)},
      hovertemplate: "%{customdata}: %{y:.1f} % of the pressing<extra></extra>", name: "played",
    });
    const hand = (x, text) => (
      {x, y: -0.2, yref: "paper", text, showarrow: false, font: {size: 12, color: muted}});
    return [traces, {
      height: 290, margin: {l: 44, r: 12, t: 8, b: 54}, barmode: "overlay",
      annotations: [hand(-3, "left hand"), hand(3, "right hand")],
      xaxis: {
        tickvals: places, ticktext: finger.map((f) => String(f % 5 + 1)), showgrid: false,
        range: [-5.7, 5.7],
      },
      yaxis: {ticksuffix: " %", rangemode: "tozero", nticks: 5},
    }];
  }

  function rewardTerms({terms, rows}) {
    const traces = rows.map(({name, sums, texts}, i) => ({
      type: "bar", orientation: "h", y: terms, x: sums, text: texts, textposition: "outside",
      cliponaxis: false, marker: {color: color(["sounding", "resting"][i])}, name,
      hovertemplate: "%{y}, " + name + ": %{text}<extra></extra>",
    }));
    const sums = rows.flatMap((row) => row.sums);
    const low = Math.min(0, ...sums), high = Math.max(0, ...sums), room = 0.25 * (high - low);
    return [traces, {
      height: 110 + 21 * sums.length, margin: {l: 90, r: 56, t: 26, b: 34}, showlegend: true,
      bargap: 0.35, bargroupgap: 0.08,
      xaxis: {nticks: 6, range: [low - (low < 0 ? room : 0), high + room]},  // for the numbers
      yaxis: {autorange: "reversed", showgrid: false},
    }];
  }

  function curves({lines, level, share}) {
    const kinds = {training: color("sounding"), evaluation: ink};
    const traces = lines.map(({name, x, y}, i) => ({
      type: "scatter", x, y, name, mode: x.length <= 40 ? "lines+markers" : "lines",
      line: {color: kinds[name] ?? series[i % series.length], width: 2}, marker: {size: 5},
      hovertemplate: name + ": %{y:.3f}<extra></extra>",
    }));
    if (level !== null) {
      const last = Math.max(...lines.map(({x}) => x[x.length - 1]));
      traces.push({
        type: "scatter", x: [0, last], y: [level, level], mode: "lines", name: "playing nothing",
        line: {color: color("resting"), width: 2, dash: "dash"},
        hovertemplate: "playing nothing: %{y:.3f}<extra></extra>",
      });
    }
    return [traces, {
      height: 250, margin: {l: 40, r: 16, t: 30, b: 40}, hovermode: "x unified", showlegend: true,
      hoverlabel: {bgcolor: paper, bordercolor: rule, font: {color: ink}},
      xaxis: {rangemode: "tozero", title: {text: "environment steps"}, nticks: 6},
      yaxis: {nticks: 6, ...(share ? {range: [0, 1.02]} : {})},
    }];
  }

  const kinds = {pianoRoll, fingerUsage, rewardTerms, curves, plotly: ({data, layout}) => [data, layout]};
  document.querySelectorAll("[data-kind]").forEach(function (place) {
    const [traces, layout] = kinds[place.dataset.kind](JSON.parse(place.nextElementSibling.textContent));
    const config = {displaylogo: false, displayModeBar: false, responsive: true, doubleClick: "reset"};
    Plotly.newPlot(place, traces, themed(layout), config);
  });

  // ---- The piano roll's legend and buttons ----------------------------------------------------

  const roll = document.getElementById("piano-roll");
  if (roll === null) return;
  const {start, end} = roll.layout.meta;

  // A finger on a small screen scrolls the page; the buttons move the view.
  if (matchMedia("(pointer: coarse)").matches) Plotly.relayout(roll, {dragmode: false});

  document.querySelectorAll("button[data-mark]").forEach(function (button) {
    button.addEventListener("click", function () {
      const shown = button.getAttribute("aria-pressed") !== "true";
      const traces = roll.data.flatMap((t, i) => t.meta === button.dataset.mark ? [i] : []);
      button.setAttribute("aria-pressed", shown);
      Plotly.restyle(roll, {visible: shown}, traces);
    });
  });

  function look(from, to) {
    const width = Math.min(Math.max(to - from, 0.5), end - start);
    const left = Math.min(Math.max(from, start), end - width);
    Plotly.relayout(roll, {"xaxis.range": [left, left + width]});
  }
  const views = {
    earlier: (a, b) => look(a - 0.8 * (b - a), b - 0.8 * (b - a)),
    later: (a, b) => look(a + 0.8 * (b - a), b + 0.8 * (b - a)),
    closer: (a, b) => look(a + 0.25 * (b - a), b - 0.25 * (b - a)),
    wider: (a, b) => look(a - 0.5 * (b - a), b + 0.5 * (b - a)),
    all: () => look(start, end),
  };
  const [first, last] = roll.layout.xaxis.range;
  if (innerWidth < 760) look(first, Math.min(last, first + 8));

  document.querySelectorAll("button[data-view]").forEach(function (button) {
    button.addEventListener("click", function () {
      views[button.dataset.view](...roll.layout.xaxis.range);
    });
  });
})();
