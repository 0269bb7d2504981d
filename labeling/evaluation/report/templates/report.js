/* Confidence, category and kind of error decide what the pictures show. The page is whole without this script. */
"use strict";
(() => {
  const at = (id) => document.getElementById(id);
  const bar = at("filter"), slider = at("confidence"), category = at("category"), kind = at("kind");
  const shown = (element, yes) => element.toggleAttribute("hidden", !yes);

  function passes(one) {
    if (category.value && one.dataset.category !== category.value) return false;
    if (one.dataset.kind === "truth" || one.dataset.kind === "missed") {
      return kind.value !== "missed" || one.dataset.kind === "missed";
    }
    if (Number(one.dataset.confidence) < Number(slider.value)) return false;
    return !kind.value || one.dataset.kind === kind.value;
  }

  function apply() {
    at("confidence-value").textContent = Number(slider.value).toFixed(2);
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
      shown(row, !category.value || row.dataset.category === category.value);
    }
    for (const curve of document.querySelectorAll("[data-curve]")) {
      shown(curve, curve.dataset.curve === category.value);
    }
    at("views-shown").textContent = `${views} views`;
  }

  shown(bar, true);
  for (const input of [slider, category, kind]) input.addEventListener("input", apply);
  at("all").addEventListener("click", () => {
    slider.value = 0; category.value = ""; kind.value = "";
    apply();
  });
  apply();
})();
