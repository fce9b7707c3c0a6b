"use strict";
// The page sends the values of its forms, and shows the fragments that the server returns.
(() => {
  const place = (id) => document.getElementById(id);
  let key = "";

  const address = new URL("socket", location.href);
  address.protocol = address.protocol.replace("http", "ws");
  const socket = new WebSocket(address);

  const ask = (kind, more) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ kind, ...more }));
  };

  // Values of all forms.
  const values = () => {
    const found = {};
    for (const form of document.querySelectorAll("form.settings"))
      for (const [name, value] of new FormData(form)) if (value && name !== "terms") found[name] = value;
    if (place("choose-terms")?.value) {
      const chosen = document.querySelectorAll("input[name=terms]:checked");
      const offered = Array.from(chosen).filter((box) => box.offsetParent); // of this model
      found.terms = offered.map((box) => box.value).join(",");
    }
    delete found["choose-terms"];
    return found;
  };

  // The address stores the values of the forms, so that a link restores them.
  let ran = new URLSearchParams(location.search).has("ran");
  const remember = (held) => history.replaceState(null, "", `?${new URLSearchParams(held)}`);
  const rememberForms = () => remember({ ...values(), ...(ran ? { ran: "yes" } : {}) });

  const show = ({ place: id, html }) => {
    const target = place(id);
    if (target) target.innerHTML = html;
    if (id === "check" && target.querySelector(".problem")) // where the user can correct it
      place("columns").querySelector("details")?.setAttribute("open", "");
    if (id === "play-controls") target.querySelectorAll("input[type=range]").forEach(label);
  };

  // Sliders: one run at a time; when it ends, the latest request follows.
  let playing = false;
  let waiting = false;

  const shown = (slider) => {
    const value = Number("log" in slider.dataset ? 10 ** slider.value : slider.value);
    return String(Number(value.toPrecision(4)));
  };

  const label = (slider) => {
    const text = `${shown(slider)} ${slider.dataset.unit}`.trim();
    slider.parentElement.querySelector("output").textContent = text;
    slider.setAttribute("aria-valuetext", text);
  };

  const standsAt = () => {
    const found = Object.fromEntries(new FormData(place("play-form")));
    for (const slider of document.querySelectorAll("#play-form input[type=range]"))
      found[slider.name] = shown(slider);
    return found;
  };

  // Values of the pinned run, as in an address; at first from the page's address.
  let pins = Object.fromEntries([...new URLSearchParams(location.search)].filter(([name]) => name.startsWith("pin")));
  const pinned = {
    pin: () => Object.fromEntries([["pin", "yes"], ...Object.entries(standsAt()).map(([name, value]) => [`pin.${name}`, value])]),
    unpin: () => ({ pin: "none" }),
    reset: () => ({}),
  };

  const play = () => {
    waiting = playing;
    if (playing) return;
    playing = true;
    const held = { ...standsAt(), ...pins };
    ask("play", { values: held });
    remember({ room: "play", ...held });
  };

  const played = () => {
    playing = false;
    if (waiting) play();
  };

  const enter = (room) => {
    for (const name of ["identify", "play"]) {
      place(`room-${name}`).hidden = name !== room;
      document.querySelector(`nav [data-target=${name}]`).setAttribute("aria-pressed", name === room);
    }
  };

  const answers = {
    played,
    room: (message) => enter(message.room),
    opened: (message) => {
      key = message.key;
      place("file").disabled = false;
    },
    show,
  };

  const upload = async (file) => {
    if (!key) return; // the window is not open yet
    const state = place("log-state");
    ran = false;
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
      if (!form.classList.contains("settings")) return;
      ask(form.dataset.kind, { values: values() });
      rememberForms();
    });
    // The report is a page of its own; its frame gets the height of its content.
    document.addEventListener("load", ({ target }) => {
      if (target.id === "report") target.style.height = `${target.contentDocument.documentElement.scrollHeight + 8}px`;
    }, true);
    document.addEventListener("submit", (event) => {
      event.preventDefault();
      if (event.target.id !== "run-form") return;
      ask("run", { values: values() });
      ran = true;
      rememberForms();
    });
    document.addEventListener("click", (event) => {
      const { kind, target } = event.target.closest("button[data-kind]")?.dataset ?? {};
      if (kind in pinned) pins = pinned[kind]();
      if (kind === "pin" || kind === "unpin") play();
      else if (kind) ask(kind, { target });
      if (kind === "reset" || target === "play") remember({ room: "play" });
      if (target === "identify") rememberForms();
    });
    place("play-form").addEventListener("input", (event) => {
      if (event.target.type === "range") label(event.target);
      play();
    });
  };

  listen();
  socket.onmessage = ({ data }) => {
    const message = JSON.parse(data);
    answers[message.kind](message);
  };
  socket.onopen = () => ask("open", { values: Object.fromEntries(new URLSearchParams(location.search)) });
  socket.onclose = () => { place("ended").hidden = false; };
})();
