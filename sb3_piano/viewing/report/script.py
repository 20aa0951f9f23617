"""The script of a report: its legend and its buttons."""

from __future__ import annotations

ROLL_ID = "piano-roll"
"""Id of the element that holds the piano roll."""

SCRIPT = f"""
(function () {{
  const roll = document.getElementById("{ROLL_ID}");
  const {{start, end}} = roll.layout.meta;

  // A finger on a small screen scrolls the page; the buttons move the view.
  if (matchMedia("(pointer: coarse)").matches) Plotly.relayout(roll, {{dragmode: false}});

  document.querySelectorAll("button[data-mark]").forEach(function (button) {{
    button.addEventListener("click", function () {{
      const shown = button.getAttribute("aria-pressed") !== "true";
      const traces = roll.data.flatMap((t, i) => t.meta === button.dataset.mark ? [i] : []);
      button.setAttribute("aria-pressed", shown);
      Plotly.restyle(roll, {{visible: shown}}, traces);
    }});
  }});

  function look(from, to) {{
    const width = Math.min(Math.max(to - from, 0.5), end - start);
    const left = Math.min(Math.max(from, start), end - width);
    Plotly.relayout(roll, {{"xaxis.range": [left, left + width]}});
  }}
  const views = {{
    earlier: (a, b) => look(a - 0.8 * (b - a), b - 0.8 * (b - a)),
    later: (a, b) => look(a + 0.8 * (b - a), b + 0.8 * (b - a)),
    closer: (a, b) => look(a + 0.25 * (b - a), b - 0.25 * (b - a)),
    wider: (a, b) => look(a - 0.5 * (b - a), b + 0.5 * (b - a)),
    all: () => look(start, end),
  }};
  const [first, last] = roll.layout.xaxis.range;
  if (innerWidth < 760) look(first, Math.min(last, first + 8));

  document.querySelectorAll("button[data-view]").forEach(function (button) {{
    button.addEventListener("click", function () {{
      views[button.dataset.view](...roll.layout.xaxis.range);
    }});
  }});
}})();
"""
