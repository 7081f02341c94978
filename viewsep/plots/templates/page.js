"use strict";
// Steps through the looks: picture, estimates and the place on the timeline. Without it the page shows the last look.
const at = (id) => document.getElementById(id);
const held = at("data");
if (held) {
  const { steps, pictures } = JSON.parse(held.textContent);
  const slider = at("step");
  const facts = document.querySelectorAll(".fact");
  const rows = document.querySelectorAll(".estimates tbody tr");

  const source = (picture) =>
    picture.startsWith("#") ? document.querySelector(picture + " img").src : picture;

  const show = (index) => {
    const step = steps[index];
    slider.value = index;
    slider.setAttribute("aria-valuetext", `look ${step.number}, ${step.facts.slice(0, 3).join(", ")}`);
    at("number").textContent = step.number;
    facts.forEach((fact, i) => { fact.textContent = step.facts[i]; });
    rows.forEach((row, i) => {
      row.querySelectorAll("td").forEach((cell, j) => { cell.textContent = step.cells[i][j]; });
      row.classList.toggle("best", step.cells[i][1] === "1.0");
    });
    if (step.picture >= 0) {
      at("picture").src = source(pictures[step.picture]);
      at("picture").alt = `Camera picture of look ${step.pictured}`;
      at("pictured").textContent = `Picture of look ${step.pictured}`;
    }
    for (const end of ["x1", "x2"]) at("cursor").setAttribute(end, `${step.percent}%`);
    at("back").disabled = index === 0;
    at("on").disabled = index === steps.length - 1;
  };

  const nearest = (value, of) =>
    steps.reduce((best, step, i) => (Math.abs(of(step) - value) < Math.abs(of(steps[best]) - value) ? i : best), 0);

  slider.addEventListener("input", () => show(Number(slider.value)));
  at("back").addEventListener("click", () => show(Math.max(0, Number(slider.value) - 1)));
  at("on").addEventListener("click", () => show(Math.min(steps.length - 1, Number(slider.value) + 1)));
  at("timeline").addEventListener("click", (event) => {
    const box = at("timeline").getBoundingClientRect();
    show(nearest((100 * (event.clientX - box.left)) / box.width, (step) => step.percent));
  });
  document.querySelectorAll(".strip a").forEach((link) => {
    link.addEventListener("click", (event) => {
      event.preventDefault();
      show(nearest(Number(link.dataset.look), (step) => step.number));
    });
  });
  document.querySelector(".slider").hidden = false;
  show(steps.length - 1);
}
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
