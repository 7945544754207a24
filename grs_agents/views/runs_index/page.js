"use strict";
// Filters of the index of runs, and two runs side by side. Text is read and compared, never parsed.
const get = (id) => document.getElementById(id);
const cards = [...get("runs").children];
const marked = () => cards.filter((card) => card.querySelector(".mark").checked);

function filter() {
  const words = get("text").value.toLowerCase().split(/\s+/).filter(Boolean);
  let count = 0;
  for (const card of cards) {
    const fits =
      words.every((word) => card.dataset.text.includes(word)) &&
      ["status", "robot"].every((key) => !get(key).value || get(key).value === card.dataset[key]);
    card.hidden = !fits;
    count += fits;
  }
  get("count").textContent = `${count} of ${cards.length} runs`;
}

function facts(card) {
  return new Map([...card.querySelectorAll("tr")].map((row) => [row.firstChild.textContent, row.lastChild]));
}

function compare() {
  const chosen = marked();
  const pair = chosen.length === 2;
  get("pair").hidden = get("clear").hidden = !pair;
  get("runs").hidden = pair;
  if (!pair) return;
  const copies = chosen.map((card) => card.cloneNode(true));
  for (const copy of copies) {
    copy.hidden = false;
    copy.querySelector("details").open = true;
  }
  const [first, second] = copies.map(facts);
  for (const name of new Set([...first.keys(), ...second.keys()])) {
    const cells = [first.get(name), second.get(name)];
    if (cells[0]?.textContent !== cells[1]?.textContent) cells.forEach((cell) => cell?.classList.add("differs"));
  }
  get("pair").replaceChildren(...copies);
  scrollTo(0, 0);
}

get("filter").hidden = false;
for (const label of document.querySelectorAll("label")) label.hidden = false;
for (const input of ["text", "status", "robot"]) get(input).addEventListener("input", filter);
get("filter").addEventListener("submit", (event) => event.preventDefault());
get("runs").addEventListener("change", compare);
get("clear").addEventListener("click", () => {
  marked().forEach((card) => (card.querySelector(".mark").checked = false));
  compare();
});
filter();
