"use strict";
// The page sends what its forms hold, and shows what the server makes of it.
(() => {
  const place = (id) => document.getElementById(id);
  let key = "";

  const ask = (kind, more) =>
    Shiny.setInputValue("request", { kind, ...more }, { priority: "event" });

  // All forms together: what the address holds, too.
  const values = () => {
    const found = {};
    for (const form of document.querySelectorAll("form.settings"))
      for (const [name, value] of new FormData(form)) if (value && name !== "terms") found[name] = value;
    if (place("choose-terms")?.value) {
      const chosen = document.querySelectorAll("input[name=terms]:checked");
      found.terms = Array.from(chosen, (box) => box.value).join(",");
    }
    delete found["choose-terms"];
    return found;
  };

  const show = ({ place: id, html }) => {
    const target = place(id);
    if (target) target.innerHTML = html;
  };

  const newFigure = (target, name) => {
    const figure = document.createElement("figure");
    figure.className = "figure";
    figure.dataset.name = name;
    for (const kind of ["h3", "figcaption", "div"]) figure.append(document.createElement(kind));
    target.append(figure);
    return figure;
  };

  const draw = ({ place: id, charts }) => {
    const target = place(id);
    const there = new Map(Array.from(target.children, (child) => [child.dataset.name, child]));
    for (const chart of charts) {
      const figure = there.get(chart.name) ?? newFigure(target, chart.name);
      there.delete(chart.name);
      figure.querySelector("h3").textContent = chart.title;
      figure.querySelector("figcaption").textContent = chart.says;
      flexid.update(figure.lastChild, chart);
    }
    for (const child of there.values()) child.remove();
  };

  const answers = {
    opened: (message) => {
      key = message.key;
      place("file").disabled = false;
    },
    show,
    draw,
    say: ({ place: id, text }) => { if (place(id)) place(id).textContent = text; },
    address: ({ query }) => history.replaceState(null, "", query ? `?${query}` : location.pathname),
  };

  const upload = async (file) => {
    const state = place("log-state");
    place("log-problem").textContent = "";
    state.textContent = `Sending ${file.name} ...`;
    try {
      const answer = await fetch(`upload/${key}`, {
        method: "POST",
        headers: { "X-File-Name": encodeURIComponent(file.name), "Content-Type": "application/octet-stream" },
        body: file,
      });
      const { problem } = await answer.json();
      if (problem) {
        state.textContent = "";
        place("log-problem").innerHTML = "<p class='problem'></p>";
        place("log-problem").firstChild.textContent = problem;
      }
    } catch {
      state.textContent = "";
      place("log-problem").textContent = "The log could not be sent: is the studio still running?";
    }
  };

  const listen = () => {
    place("file").addEventListener("change", (event) => {
      if (event.target.files[0]) upload(event.target.files[0]);
    });
    const drop = place("drop");
    for (const name of ["dragover", "dragleave", "drop"])
      document.addEventListener(name, (event) => {
        event.preventDefault();
        drop.classList.toggle("over", name === "dragover");
        if (name === "drop" && event.dataTransfer.files[0]) upload(event.dataTransfer.files[0]);
      });
    document.addEventListener("change", (event) => {
      const form = event.target.closest("form[data-kind]");
      if (!form) return;
      if (event.target.id === "choose-terms") place("terms").hidden = !event.target.value;
      event.target.closest("tr")?.classList.toggle(
        "unused", !event.target.closest("tr").querySelector("select").value);
      if (form.dataset.kind === "columns") ask("columns", { values: values() });
    });
    document.addEventListener("submit", (event) => {
      event.preventDefault();
      ask(event.target.id === "run-form" ? "run" : event.target.dataset.kind, { values: values() });
    });
    document.addEventListener("click", (event) => {
      const button = event.target.closest("button[data-kind]");
      if (button) ask(button.dataset.kind, { target: button.dataset.target });
    });
  };

  listen();
  Shiny.addCustomMessageHandler("studio", (message) => answers[message.kind](message));
  $(document).on("shiny:sessioninitialized", () =>
    ask("open", { values: Object.fromEntries(new URLSearchParams(location.search)) }));
  $(document).on("shiny:disconnected", () => { place("ended").hidden = false; });
})();
