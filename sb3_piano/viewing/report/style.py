"""The style sheet of a report."""

from __future__ import annotations

from sb3_piano.viewing.report.theme import FONT, INK, MUTED, PAPER, RULE, SHADE, SOUNDING

STYLE = f"""
:root {{ color-scheme: light; }}
* {{ box-sizing: border-box; }}
body {{ margin: 0; background: #faf9f6; color: {INK}; font: 15px/1.5 {FONT}; }}
main {{ max-width: 1120px; margin: 0 auto; padding: 36px 24px 64px; }}
h1 {{ font-size: 30px; line-height: 1.2; margin: 2px 0 6px; letter-spacing: -.01em; }}
h2 {{ font-size: 18px; margin: 0 0 2px; }}
h3 {{ font-size: 14px; margin: 0 0 4px; }}
h1, dd, td, p {{ overflow-wrap: anywhere; }}
p {{ margin: 0 0 12px; }}
.eyebrow, .note {{ color: {MUTED}; }}
.eyebrow {{ font-size: 13px; margin: 0; }}
.note {{ font-size: 14px; max-width: 80ch; }}
section {{ background: {PAPER}; border: 1px solid {RULE}; border-radius: 10px;
  padding: 18px 20px; margin-top: 18px; min-width: 0; }}
.pair {{ display: grid; grid-template-columns: 1fr 1fr; gap: 0 18px; }}
.grid {{ display: grid; grid-template-columns: 1fr 1fr; gap: 10px 24px; }}
.tiles {{ display: grid; grid-template-columns: repeat(4, 1fr); gap: 12px; margin: 20px 0 0; }}
.tile {{ background: {PAPER}; border: 1px solid {RULE}; border-radius: 10px; padding: 12px 16px; }}
.tile dt {{ font-size: 13px; color: {MUTED}; }}
.tile dd {{ margin: 0; }}
.tile .value {{ font-size: 26px; line-height: 1.25; font-variant-numeric: tabular-nums; }}
.tile .beside {{ font-size: 13px; color: {MUTED}; }}
.bar {{ position: relative; height: 5px; border-radius: 3px; background: {SHADE}; margin: 6px 0; }}
.bar i {{ position: absolute; inset: 0 auto 0 0; border-radius: 3px; background: {SOUNDING}; }}
.bar b {{ position: absolute; top: -3px; bottom: -3px; width: 2px; background: {INK}; }}
.legend {{ display: flex; flex-wrap: wrap; gap: 6px; margin: 10px 0; align-items: center; }}
.legend .group {{ color: {MUTED}; font-size: 13px; width: 48px; }}
button {{ font: inherit; font-size: 13px; color: {INK}; background: {PAPER}; cursor: pointer;
  border: 1px solid {RULE}; border-radius: 6px; padding: 3px 9px; }}
button:hover {{ border-color: {MUTED}; }}
button[aria-pressed=false] {{ opacity: .45; text-decoration: line-through; }}
.swatch {{ display: inline-block; width: 18px; height: 12px; border-radius: 2px;
  margin-right: 6px; vertical-align: -1px; }}
.swatch.cross {{ width: 12px; }}
.views {{ display: flex; flex-wrap: wrap; gap: 6px; margin: 10px 0 0; }}
dl.words {{ display: grid; grid-template-columns: repeat(2, max-content 1fr); gap: 3px 14px;
  margin: 8px 0 0; font-size: 14px; }}
dl.words dt {{ font-weight: 600; }}
dl.words dd {{ margin: 0; color: {MUTED}; }}
.wide {{ overflow-x: auto; }}
.wide td, .wide th {{ white-space: nowrap; }}
details {{ margin-top: 10px; }}
details summary {{ cursor: pointer; color: {MUTED}; font-size: 14px; }}
table {{ border-collapse: collapse; width: 100%; font-size: 14px; }}
th, td {{ text-align: left; padding: 5px 10px 5px 0; border-top: 1px solid {RULE};
  vertical-align: top; font-weight: normal; }}
thead th {{ color: {MUTED}; font-size: 13px; border-top: 0; }}
tr.group th {{ font-weight: 600; padding-top: 14px; border-top: 0; }}
td.number, th.number {{ text-align: right; white-space: nowrap; padding-right: 22px;
  font-variant-numeric: tabular-nums; }}
td.meaning {{ color: {MUTED}; }}
code {{ font: 13px/1.5 ui-monospace, 'SF Mono', Menlo, Consolas, monospace; background: {SHADE};
  padding: 1px 5px; border-radius: 4px; overflow-wrap: anywhere; }}
dl.facts {{ display: grid; grid-template-columns: max-content 1fr; gap: 4px 18px; margin: 8px 0 0;
  font-size: 14px; }}
dl.facts dt {{ color: {MUTED}; }}
dl.facts dd {{ margin: 0; }}
@media (max-width: 760px) {{
  main {{ padding: 20px 12px 40px; }}
  section {{ padding: 14px 12px; }}
  h1 {{ font-size: 25px; }}
  .pair, .grid {{ grid-template-columns: 1fr; }}
  .tiles {{ grid-template-columns: 1fr 1fr; gap: 8px; }}
  .tile {{ padding: 10px 12px; }}
  dl.words, dl.facts {{ grid-template-columns: 1fr; gap: 0; }}
  dl.words dd, dl.facts dd {{ margin-bottom: 8px; }}
  tr.group th {{ padding-top: 18px; }}
  table.metrics tr {{ display: grid; grid-template-columns: 1fr auto auto; }}
  table.metrics tr.group {{ display: block; }}
  table.metrics td.meaning {{ grid-column: 1 / -1; border-top: 0; padding-top: 0;
    font-size: 13px; }}
  table.metrics thead th.meaning {{ display: none; }}
  td.number, th.number {{ padding: 5px 0 5px 14px; min-width: 84px; }}
}}
@media print {{ body {{ background: none; }} .views, .legend button {{ border: 0; }} }}
"""
