"use strict";
// Excerpts of the pages found are fetched, which a browser forbids in a folder that it opens itself.
if (location.protocol === "file:") DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;

document.addEventListener("DOMContentLoaded", () => {
  for (const form of document.querySelectorAll(".filters")) filterClaims(form);
  for (const box of document.querySelectorAll("div.math")) {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0; // a formula wider than a telephone
  }
});

function filterClaims(form) {
  const rows = [...document.querySelectorAll(".claims tbody tr")];
  const fields = [...form.querySelectorAll("[data-column]")];
  const key = ({ dataset }) => dataset.column || "text";
  const linked = new URLSearchParams(location.search); // a link may carry what is asked for
  for (const field of fields) if (linked.has(key(field))) field.value = linked.get(key(field));
  const show = () => {
    const asked = fields.filter((field) => field.value);
    let left = 0;
    for (const row of rows) {
      row.hidden = !asked.every(({ dataset, value }) =>
        dataset.column ? row.dataset[dataset.column] === value
          : row.textContent.toLowerCase().includes(value.toLowerCase()));
      left += !row.hidden;
    }
    form.querySelector("output").value = `${left} of ${rows.length} claims`;
    const query = new URLSearchParams(asked.map((field) => [key(field), field.value]));
    const address = `${location.pathname}${asked.length ? `?${query}` : ""}${location.hash}`;
    if (location.protocol !== "file:") history.replaceState(null, "", address); // a browser forbids it there
  };
  form.addEventListener("input", show);
  form.addEventListener("submit", (event) => event.preventDefault());
  show(); // the browser keeps the fields when it comes back to the page
}
