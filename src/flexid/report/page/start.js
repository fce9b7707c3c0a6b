// Figures that stand in the page already, each with its document beside it.
for (const element of document.querySelectorAll("[data-chart]")) {
  flexid.draw(element, JSON.parse(element.querySelector("script").textContent));
}
