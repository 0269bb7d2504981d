"""The look of a report: one style sheet, no external fonts, dark on light, from phone to wide screen."""

CSS = """
:root { --ink: #1f2328; --soft: #59636e; --line: #d8dee4; --paper: #ffffff; --page: #f6f8fa;
        --detector: #8a94a0; --labels: #0f766e; --bad: #b42318; --good: #137a3e; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
       font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", sans-serif; }
main { max-width: 1240px; margin: 0 auto; padding: 28px 20px 60px; }
h1 { font-size: 26px; line-height: 1.25; margin: 0; letter-spacing: -.01em; }
h2 { font-size: 19px; margin: 36px 0 6px; }
h3 { font-size: 15px; margin: 0 0 8px; font-weight: 600; overflow-wrap: anywhere; }
p { margin: 4px 0 12px; max-width: 85ch; }
.soft { color: var(--soft); }
.card { background: var(--paper); border: 1px solid var(--line); border-radius: 8px; padding: 16px 18px;
        margin: 12px 0; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px; margin: 18px 0 4px; }
.cards .card { margin: 0; padding: 12px 16px; }
.cards .name { color: var(--soft); font-size: 13px; }
.cards .value { font-size: 26px; font-weight: 650; line-height: 1.3; font-variant-numeric: tabular-nums; }
.cards .from { font-size: 13px; color: var(--soft); font-variant-numeric: tabular-nums; }
.up { color: var(--good); font-weight: 600; } .down { color: var(--bad); font-weight: 600; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 6px 12px; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { font-weight: 600; color: var(--soft); font-size: 13px; }
th:first-child, td:first-child { text-align: left; padding-left: 0; white-space: normal; overflow-wrap: anywhere; }
td:first-child { min-width: 130px; }
tr:last-child td { border-bottom: 0; }
.note { border-left: 4px solid #d29922; background: #fff8e6; padding: 8px 14px; margin: 8px 0; border-radius: 4px;
        overflow-wrap: anywhere; }
.legend { display: flex; gap: 18px; font-size: 13px; color: var(--soft); flex-wrap: wrap; margin: 4px 0 10px; }
.legend i, .ious i { display: inline-block; width: 11px; height: 11px; border-radius: 2px; margin-right: 6px; }
.bars { display: grid; grid-template-columns: minmax(110px, 220px) 1fr 1fr 1fr; gap: 10px 24px; align-items: center; }
.bars .head { font-size: 13px; color: var(--soft); font-weight: 600; }
.bars .class { overflow-wrap: anywhere; line-height: 1.3; } .bars .class small { color: var(--soft); display: block; }
.bar { display: flex; align-items: center; gap: 8px; font-size: 12.5px; font-variant-numeric: tabular-nums; }
.bar .track { flex: 1; background: #eaeef2; border-radius: 2px; height: 10px; margin: 2px 0; min-width: 40px; }
.bar .fill { height: 10px; border-radius: 2px; }
.bar .number { width: 3.2em; text-align: right; }
.detector { background: var(--detector); } .labels { background: var(--labels); }
.strip { display: grid; grid-template-columns: repeat(3, 1fr); gap: 10px; }
figure { margin: 0; } figure svg { width: 100%; height: auto; display: block; border-radius: 4px; background: #d8dee4;
         font-family: system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif; }
figcaption { font-size: 13px; font-weight: 600; padding: 4px 2px 0; }
figcaption span { color: var(--soft); font-weight: 400; }
.ious { list-style: none; display: flex; flex-wrap: wrap; gap: 2px 18px; margin: 8px 0 0; padding: 0; font-size: 13px;
        font-variant-numeric: tabular-nums; }
.ious li { overflow-wrap: anywhere; } .ious .lead { color: var(--soft); }
.rank { display: inline-block; min-width: 26px; padding: 0 6px; margin-right: 8px; text-align: center;
        border-radius: 10px;
        background: var(--ink); color: #fff; font-size: 13px; line-height: 20px; }
.tally { font-weight: 400; color: var(--soft); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 6px 20px; margin: 0; }
dt { font-weight: 600; } dd { margin: 0; max-width: 95ch; overflow-wrap: anywhere; }
pre { background: var(--page); border: 1px solid var(--line); border-radius: 6px; padding: 12px; overflow: auto;
      max-height: 420px; font-size: 12.5px; line-height: 1.45; }
.store { position: absolute; }
@media (max-width: 760px) {
  main { padding: 18px 12px 40px; } h1 { font-size: 22px; }
  .strip { grid-template-columns: 1fr; } .bars { grid-template-columns: 1fr; gap: 4px; }
  .bars .head { display: none; }
  .bars .class { margin-top: 12px; font-weight: 600; }
  .bar::before { content: attr(data-name); width: 6.5em; color: var(--soft); }
  dl { grid-template-columns: 1fr; } dd { margin-bottom: 10px; }
}
@media print { body { background: #fff; } .card { break-inside: avoid; } }
"""
