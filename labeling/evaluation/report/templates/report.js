/* Confidence, category and kind of error decide what figures and pictures show. The page is whole without this script. */
"use strict";
(() => {
  const at = (id) => document.getElementById(id);
  const bar = at("filter"), slider = at("confidence"), category = at("category"), kind = at("kind");
  const shown = (element, yes) => element.toggleAttribute("hidden", !yes);
  const numbers = JSON.parse(at("numbers").dataset.numbers);
  const tabs = [...document.querySelectorAll(".tab")];

  function passes(one) {
    if (category.value && one.dataset.category !== category.value) return false;
    if (one.dataset.kind === "truth" || one.dataset.kind === "missed") {
      return kind.value !== "missed" || one.dataset.kind === "missed";
    }
    if (Number(one.dataset.confidence) < Number(slider.value)) return false;
    return !kind.value || one.dataset.kind === kind.value;
  }

  /* The count at the slider's confidence: changes are confidence in hundredths, count, and so on. */
  function count(changes) {
    const step = Math.round(100 * Number(slider.value));
    let index = 0;
    while (index + 2 < changes.length && changes[index + 2] <= step) index += 2;
    return changes[index + 1];
  }

  function total(rows, key) {
    return rows.filter((row) => (!category.value || row[0] === category.value) && (key === undefined || row[1] === key))
      .reduce((sum, row) => sum + count(row[row.length - 1]), 0);
  }

  function figure(method, name) {
    const of = numbers[method], instances = total(of.ious);
    const right = total(of.kinds, "right"), claims = total(of.kinds) - total(of.kinds, "missed") - total(of.kinds, "ignored");
    const [above, below] = { precision: [right, claims], recall: [right, instances], mean_iou: [total(of.iou_sum), instances] }[name];
    return below ? (above / below).toFixed(3) : "–";
  }

  function applyToFigures() {
    for (const one of document.querySelectorAll("[data-error]")) {
      one.textContent = total(numbers[one.dataset.method].kinds, one.dataset.error).toLocaleString("en");
    }
    for (const one of document.querySelectorAll("[data-figure]")) {
      one.textContent = figure(one.dataset.method, one.dataset.figure);
    }
    for (const one of document.querySelectorAll(".confidence-value")) one.textContent = Number(slider.value).toFixed(2);
    for (const chart of document.querySelectorAll("svg[data-most]")) {
      const { floor, top, most } = chart.dataset;
      for (const method of Object.keys(numbers)) {
        chart.querySelectorAll(`rect.${method}`).forEach((rect, part) => {
          const value = total(numbers[method].ious, part), height = ((floor - top) * value) / most;
          rect.setAttribute("y", floor - height);
          rect.setAttribute("height", height);
          rect.querySelector("title").textContent = value;
        });
      }
    }
    for (const table of document.querySelectorAll("table.confusion")) applyToConfusion(table);
  }

  function applyToConfusion(table) {
    const found = new Map(numbers[table.dataset.method].confusion.map(([row, column, changes]) =>
      [JSON.stringify([row, column]), count(changes)]));
    const columns = [...table.tHead.rows[0].cells].slice(1);
    const used = columns.map((_, index) => index === columns.length - 1);
    for (const row of table.tBodies[0].rows) {
      const counts = columns.map((column) => found.get(JSON.stringify([row.dataset.row, column.dataset.column])) || 0);
      const sum = counts.reduce((a, b) => a + b, 0);
      counts.forEach((value, index) => {
        const cell = row.cells[index + 1], right = columns[index].dataset.column === row.dataset.row;
        cell.textContent = value || "";
        cell.style.background = value ? `rgba(${right ? "19,122,62" : "180,35,24"},${((0.6 * value) / sum).toFixed(2)})` : "";
        used[index] ||= value > 0;
      });
      shown(row, sum > 0);
    }
    for (const row of table.rows) used.forEach((yes, index) => shown(row.cells[index + 1], yes));
  }

  function apply() {
    applyToFigures();
    let views = 0;
    for (const view of document.querySelectorAll(".view")) {
      let match = !category.value && !kind.value;
      for (const one of view.querySelectorAll("[data-kind]")) {
        const yes = passes(one);
        shown(one, yes);
        match ||= yes && (!kind.value || one.dataset.kind === kind.value);
      }
      for (const line of view.querySelectorAll(".ious [data-category]")) {
        shown(line, !category.value || line.dataset.category === category.value);
      }
      for (const figure of view.querySelectorAll("figure")) {
        const count = figure.querySelector(".count"), all = figure.querySelectorAll("g.one");
        const drawn = [...all].filter((one) => !one.hasAttribute("hidden")).length;
        count.textContent = drawn === Number(count.dataset.total) ? `${drawn}` : `${drawn} of ${count.dataset.total} drawn`;
      }
      shown(view, match);
      views += match;
    }
    for (const row of document.querySelectorAll("tr[data-category]")) {
      const sure = Number(row.dataset.confidence) >= Number(slider.value);
      shown(row, sure && (!category.value || row.dataset.category === category.value));
    }
    for (const curve of document.querySelectorAll("[data-curve]")) {
      shown(curve, curve.dataset.curve === category.value);
    }
    at("views-shown").textContent = `${views} views`;
    document.dispatchEvent(new Event("filtered"));
  }

  function openTab() {
    const asked = tabs.find((tab) => tab.id === `tab-${location.hash.slice(1)}`) || tabs[0];
    for (const tab of tabs) shown(tab, tab === asked);
    for (const link of document.querySelectorAll("#tabs a")) {
      link.toggleAttribute("aria-current", asked.id === `tab-${link.hash.slice(1)}`);
    }
    for (const one of document.querySelectorAll(".of-views")) shown(one, asked.id === "tab-views");
    document.dispatchEvent(new Event("filtered"));
  }

  shown(bar, true);
  for (const input of [slider, category, kind]) input.addEventListener("input", apply);
  at("all").addEventListener("click", () => {
    slider.value = 0; category.value = ""; kind.value = "";
    apply();
  });
  window.addEventListener("hashchange", () => {
    openTab();
    window.scrollTo(0, 0);
  });
  openTab();
  apply();
})();
