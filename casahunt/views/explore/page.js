"use strict";
/* The page of casahunt explore: native controls ask, numbers and figures answer.  The state is the query of the address.
   To the server: {n, ask, choose | preset | file | page}.  From it: state, refused, stage, done, page, full. */
(() => {
  const STEPS = 1000, SLIDER_DIGITS = 4, SHOWN_DIGITS = 6, AGAIN = 2000, MOST_UNDO = 100, SAME_MOVE = 1000;
  const byId = (id) => document.getElementById(id);
  const frozen = JSON.parse(byId("frozen").textContent);
  let socket = null, n = 0, address = location.search.slice(1), copies = {}, controls = [], shown = {};
  let rebuild = true, moved = "", lastMove = {key: "", at: 0}, waiting = false, refusedAt = "";
  const undo = [], times = [], views = {};
  window.casahunt = {times, get n() { return n; }, get address() { return address; }, get shown() { return shown; }};

  // Numbers ------------------------------------------------------------------------------------------------------
  const positionOf = (c, value) => {
    if (!c.log) return Math.round(STEPS * (value - c.low) / (c.high - c.low));
    if (value <= 0) return 0;
    return Math.max(c.zero ? 1 : 0, Math.round(STEPS * Math.log(value / c.low) / Math.log(c.high / c.low)));
  };
  const valueAt = (c, position) => {
    if (c.log && c.zero && position === 0) return 0;
    const part = position / STEPS;
    const value = c.log ? c.low * Math.pow(c.high / c.low, part) : c.low + part * (c.high - c.low);
    return Number(value.toPrecision(SLIDER_DIGITS));
  };
  const written = (value) => (value === null ? "" : String(Number(value.toPrecision(SHOWN_DIGITS))));

  // Controls -----------------------------------------------------------------------------------------------------
  const element = (name, attributes = {}, ...children) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };
  const controlOf = (c) => {
    const unit = c.unit ? ` [${c.unit}]` : "";
    const label = element("label", {for: `n-${c.key}`}, c.label, element("span", {class: "unit"}, unit));
    const text = element("input", {type: "text", inputmode: "decimal", id: `n-${c.key}`, "aria-describedby": `r-${c.key}`});
    const slider = element("input", {type: "range", id: `s-${c.key}`, min: 0, max: STEPS, step: 1, "aria-label": `${c.label} slider`});
    const refusal = element("p", {class: "refusal", id: `r-${c.key}`, role: "alert"});
    refusal.hidden = true;
    slider.addEventListener("input", () => {
      const value = valueAt(c, Number(slider.value));
      text.value = written(value);
      slider.setAttribute("aria-valuetext", `${text.value} ${c.unit}`);
      move(c.key, text.value);
    });
    text.addEventListener("change", () => { place(c, Number(text.value)); move(c.key, text.value.trim()); });
    if (frozen) text.disabled = slider.disabled = true;
    return element("div", {class: "control"}, label, text, slider, refusal);
  };
  const place = (c, value) => {
    const slider = byId(`s-${c.key}`);
    slider.value = positionOf(c, value);
    slider.setAttribute("aria-valuetext", `${written(value)} ${c.unit}`);
  };
  const build = (message) => {
    const focused = document.activeElement && document.activeElement.id;
    const groups = new Map();
    for (const c of message.controls) {
      if (!groups.has(c.group)) groups.set(c.group, element("fieldset", {}, element("legend", {}, c.group)));
      groups.get(c.group).append(controlOf(c));
    }
    byId("controls").replaceChildren(...groups.values());
    byId("choices").replaceChildren();
    for (const [what, choice] of Object.entries(message.choices)) {
      const select = element("select", {id: `c-${what}`});
      for (const [value, label] of choice.options) select.append(new Option(label, value, false, value === choice.chosen));
      select.disabled = Boolean(frozen);
      select.addEventListener("change", () => { remember(what); ask({choose: [what, select.value]}); });
      byId("choices").append(element("label", {for: select.id}, choice.label), select);
    }
    controls = message.controls;
    for (const c of controls) { byId(`n-${c.key}`).value = written(c.value); place(c, c.value); }
    if (focused && byId(focused)) byId(focused).focus();
  };
  const refuse = (key, sentence) => {
    const at = byId(`r-${key}`);
    if (!at) return alarm(sentence);
    refusedAt = key;
    at.textContent = sentence;
    at.hidden = false;
    byId(`n-${key}`).setAttribute("aria-invalid", "true");
  };
  const pardon = () => {
    alarm("");
    if (!refusedAt || !byId(`r-${refusedAt}`)) { refusedAt = ""; return; }
    byId(`r-${refusedAt}`).hidden = true;
    byId(`r-${refusedAt}`).textContent = "";
    byId(`n-${refusedAt}`).removeAttribute("aria-invalid");
    refusedAt = "";
  };
  const alarm = (sentence) => { byId("alarm").textContent = sentence; byId("alarm").hidden = !sentence; };

  // Asking -------------------------------------------------------------------------------------------------------
  const wanted = new Map();
  const remember = (key) => {
    const now = performance.now();
    if (lastMove.key !== key || now - lastMove.at > SAME_MOVE) {
      undo.push(address);
      if (undo.length > MOST_UNDO) undo.shift();
    }
    lastMove = {key, at: now};
    byId("undo").disabled = undo.length === 0;
  };
  const move = (key, text) => {
    if (frozen) return;
    remember(key);
    wanted.set(key, text);
    moved = key;
    if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; ask({}); }); }
  };
  const ask = (more) => {
    if (!socket || socket.readyState !== WebSocket.OPEN) return;
    const query = new URLSearchParams(more.address !== undefined ? more.address : address);
    for (const [key, text] of wanted) query.set(key, text);
    if (more.address !== undefined) { wanted.clear(); }
    rebuild = rebuild || Object.keys(more).length > 0;
    n += 1;
    times.push({n, asked: performance.now()});
    if (times.length > 200) times.shift();
    byId("busy").hidden = false;
    socket.send(JSON.stringify({n, moved, ...more, ask: query.toString()}));
  };
  const timed = (name) => { const last = times[times.length - 1]; if (last && !(name in last)) last[name] = performance.now() - last.asked; };

  // Answers ------------------------------------------------------------------------------------------------------
  const heard = (message) => {
    if (message.kind === "full") { alarm(message.sentence); byId("busy").hidden = true; return; }
    if (message.kind === "page") { save("casahunt.html", "text/html", message.html); return; }
    if (message.n !== n) return;
    if (message.kind === "refused") {
      pardon();
      byId("busy").hidden = true;
      if (!controls.length) byId("sentence").textContent = "The address of this page is refused, and nothing is computed.";
      refuse(message.key, controls.length ? message.sentence : `${message.sentence}. Begin with one of the servos at the left, ` +
        "or mend the address.");
      timed("refused");
    } else if (message.kind === "state") {
      pardon();
      address = message.address;
      wanted.clear();
      copies = message.copies;
      byId("note").textContent = message.note;
      byId("note").hidden = !message.note;
      shown = {};
      if (!frozen) history.replaceState(null, "", `${location.pathname}?${address}`);
      const same = controls.length === message.controls.length && controls.every((c, i) => c.key === message.controls[i].key);
      if (rebuild || !same) build(message);
      rebuild = false;
      for (const stale of document.querySelectorAll("[data-stage]")) stale.classList.add("stale");
    } else if (message.kind === "stage") {
      show(message.stage, message.shown);
      timed(message.stage);
    } else if (message.kind === "done") {
      byId("busy").hidden = true;
      if (message.shown && message.shown.why) alarm(message.shown.why);
      timed("done");
    }
  };
  const NUMBERS = [
    ["hunts", "amplitude", "swing to either side", "rad"], ["hunts", "period", "period", "s"],
    ["border", "gain", "hunting ends at gain", "V/rad"], ["border", "ratio", "how far off that is", ""],
    ["border", "size", "hunting ends at", ""], ["step", "peak", "largest torque of the step", "N m"],
    ["step", "voltage", "largest voltage", "V"], ["linear", "phase_margin", "phase margin, without dry friction", "°"],
    ["linear", "crossover", "crossover", "rad/s"],
  ];
  const inPlace = (what) => ({rests: "none: it does not hunt", unknown: "not found"})[what.verdict] || what.why;
  const numbers = (stage) => {
    const what = shown[stage], said = new Set();
    for (const [place_of, [of, key, name, unit]] of NUMBERS.entries()) {
      if (of !== stage) continue;
      let box = byId(`number-${key}`);
      const why = key === "size" ? what.remedy_why : inPlace(what);
      const again = !what[key] && what.why && stage !== "hunts" && said.has(why);  // one sentence for several: once
      said.add(why);
      if (again || key === "size" && !what.size && !why) { if (box) box.remove(); continue; }
      if (!box) {
        box = element("div", {id: `number-${key}`, "data-stage": stage, style: `order: ${place_of}`}, element("dt"), element("dd"));
        byId("numbers").append(box);
      }
      const [term, value] = box.children;
      term.textContent = key === "size" ? `hunting ends at ${what.size_name || "a size"}` : name;
      const found = what[key];
      value.classList.toggle("none", !found);
      value.textContent = found ? found.said || `${found.text} ${key === "size" ? what.size_unit : unit}`.trim() : why || "none";
      if (found && found.error) value.append(element("small", {}, `computed to ± ${found.error.toExponential(0)}`));
      if (key === "phase_margin" && what.factors && what.factors.length)
        value.append(element("small", {}, `${what.stable ? "stable" : "unstable"}; changes at ${what.factors.join(" and ")} times the gain`));
      if (key === "phase_margin" && what.stable === false && !(what.factors || []).length) value.append(element("small", {}, "unstable"));
      if (key === "peak" && what.ends) value.append(element("small", {}, what.ends));
      box.classList.remove("stale");
    }
  };
  const CURVES = {hunts: [["cycle", ["angle", "velocity", "torque", "phase"]]], step: [["motion", ["position", "effort"]]],
    linear: [["friction", ["friction"]]]};
  const show = (stage, what) => {
    shown[stage] = what;
    if (what.sentence) byId("sentence").textContent = what.sentence;
    if (stage === "hunts") {
      byId("why").textContent = what.why || "";
      for (const name of ["sentence", "why"]) byId(name).classList.remove("stale");
    }
    numbers(stage);
    evidence();
    for (const [key, figures] of CURVES[stage] || []) for (const name of figures) draw(name, key, what[key], inPlace(what));
    if (stage === "step") locate("set point", Number(new URLSearchParams(address).get("step")));
    if (stage === "border") locate("border", what.gain ? what.gain.value : null);
    if (stage === "diagram") {
      draw("diagram", "stable", what.stable, what.why);
      draw("diagram", "unstable", what.unstable, what.why);
      unfinished(what);
    }
    if (stage === "hunts") locate("present", gainNow());
    if (stage === "hunts" || stage === "diagram") mark();
  };
  // A curve that is not followed to its end: where, in the picture, and why, below it.
  const unfinished = (what) => {
    const at = what.unfinished, missing = byId("diagram-figure").querySelector(".missing");
    missing.classList.toggle("below", Boolean(at));
    if (at) missing.textContent = what.why;
    const source = model("diagram", "unfinished");
    if (source) source.data = at || {gain: [], amplitude: []};
  };
  const evidence = () => {
    const said = [...new Set(Object.values(shown).map((what) => what.evidence).filter(Boolean))];
    byId("evidence").hidden = !said.length;
    byId("evidence").querySelector("ul").replaceChildren(...said.map((one) => element("li", {}, one)));
  };
  // The present cycle as a point, and where there is none, nothing to be seen at its gain: it belongs to the picture.
  const mark = () => {
    const {hunts, diagram} = shown, found = hunts && hunts.amplitude ? hunts.amplitude.value : null;
    const some = ["stable", "unstable"].flatMap((name) => (diagram && diagram[name] ? diagram[name].amplitude : []));
    const amplitude = found || some.find((x) => x !== null);
    for (const [name, there] of [["now", found], ["reach", amplitude]]) {
      const source = model("diagram", name);
      if (source) source.data = there ? {gain: [gainNow()], amplitude: [there]} : {gain: [], amplitude: []};
    }
  };
  const gainNow = () => Number(new URLSearchParams(address).get("gain"));
  const model = (figure, name) => views[figure] && views[figure].document.get_model_by_name(name);
  const draw = (figure, key, columns, why) => {
    const box = byId(`${figure}-figure`);
    box.classList.remove("stale");
    const missing = box.querySelector(".missing");
    missing.textContent = columns ? "" : why || "nothing to draw";
    if (!views[figure]) return;
    const source = model(figure, key), drawn = {};
    for (const name of Object.keys(source.data)) drawn[name] = (columns ? columns[name] : []).map((x) => (x === null ? NaN : x));
    source.data = drawn;
    describe(figure, missing.textContent);
  };
  // What is drawn now, of each curve, for who does not see it; where there is none, why.
  const describe = (figure, why) => {
    const box = byId(`${figure}-figure`), said = [];
    for (const source of sources(figure)) {
      const ranges = Object.entries(source.data).map(([name, column]) => {
        const there = [...column].filter(Number.isFinite);
        return there.length && `${name} from ${Math.min(...there).toPrecision(3)} to ${Math.max(...there).toPrecision(3)}`;
      });
      if (ranges.every(Boolean)) said.push(`${figure === "diagram" ? `${source.name} cycles, ` : ""}${ranges.join(", ")}`);
    }
    box.querySelector(".plot").setAttribute("aria-label", `${box.querySelector("figcaption").textContent}: ${said.join("; ") || why}`);
  };
  const sources = (figure) => (figure === "diagram" ? ["stable", "unstable"] : ["cycle", "motion", "friction"])
    .map((name) => model(figure, name)).filter(Boolean);
  const locate = (name, value) => {
    const figure = name === "set point" ? "position" : "diagram";
    const span = model(figure, name);
    if (span) { if (value) span.location = value; span.visible = Boolean(value); }
  };

  // What a figure can do the sliders can too: the Tab key passes it over.
  const passedOver = (at) => {
    for (const inside of at.querySelectorAll("*")) {
      if (inside.tabIndex >= 0) inside.tabIndex = -1;
      if (inside.shadowRoot) passedOver(inside.shadowRoot);
    }
  };

  // Figures ------------------------------------------------------------------------------------------------------
  const embed = async () => {
    const items = JSON.parse(byId("items").textContent);
    Bokeh.set_log_level("error");
    for (const [name, item] of Object.entries(items)) {
      const found = await Bokeh.embed.embed_item(item, `${name}-plot`);
      const roots = [...found];
      views[name] = {view: roots[0], document: roots[0].model.document};
      passedOver(byId(`${name}-plot`));
    }
    const choose = (event) => {
      if (frozen || !(event.x > 0)) return;
      const c = controls.find((each) => each.key === "gain");
      const value = Number(event.x.toPrecision(SLIDER_DIGITS));
      byId("n-gain").value = written(value);
      place(c, value);
      locate("present", value);
      move("gain", written(value));
    };
    const figure = views.diagram.view.model;
    for (const event of ["tap", "pan"]) figure.on_event(event, choose);
    for (const [stage, what] of Object.entries(shown)) show(stage, what);
    window.casahunt.ready = true;
  };

  // Copies -------------------------------------------------------------------------------------------------------
  const save = (name, type, content) => {
    const url = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], {type}));
    const link = element("a", {href: url, download: name});
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), AGAIN);
  };
  const copy = async (what) => {
    byId("copied").value = copies[what];
    try {
      await navigator.clipboard.writeText(copies[what]);
      byId("copy-said").textContent = "Copied.";
    } catch {
      byId("copied").select();
      byId("copy-said").textContent = "The text is below and marked: copy it with Ctrl-C.";
    }
  };
  const picture = () => {
    const drawn = Object.entries(views).map(([name, {view}]) => [name, view.export("png", false).canvas]);
    const wide = Math.max(...drawn.map(([, c]) => c.width)), high = Math.max(...drawn.map(([, c]) => c.height)) + 24;
    const all = element("canvas"), across = 2, top = 70;
    all.width = across * wide + 20;
    all.height = top + Math.ceil(drawn.length / across) * high;
    const pen = all.getContext("2d");
    pen.fillStyle = "#fff";
    pen.fillRect(0, 0, all.width, all.height);
    pen.fillStyle = "#000";
    pen.font = "bold 18px sans-serif";
    let line = "", row = 22;
    for (const word of byId("sentence").textContent.split(" ")) {
      if (pen.measureText(`${line} ${word}`).width > all.width - 20) { pen.fillText(line, 10, row); line = ""; row += 22; }
      line = `${line} ${word}`.trim();
    }
    pen.fillText(line, 10, row);
    pen.font = "14px sans-serif";
    drawn.forEach(([name, canvas], i) => {
      const x = (i % across) * (wide + 20), y = top + Math.floor(i / across) * high;
      pen.fillText(byId(`${name}-figure`).querySelector("figcaption").textContent, x + 10, y + 16);
      pen.drawImage(canvas, x, y + 22);
    });
    all.toBlob((blob) => save("casahunt.png", "image/png", blob), "image/png");
  };
  for (const button of document.querySelectorAll("[data-copy]")) button.addEventListener("click", () => copy(button.dataset.copy));
  byId("save-file").addEventListener("click", () => save("servo.toml", "text/plain", copies.file));
  byId("save-png").addEventListener("click", picture);
  byId("save-page").addEventListener("click", () => socket && socket.send(JSON.stringify({n, page: true})));
  byId("undo").addEventListener("click", () => {
    const last = undo.pop();
    byId("undo").disabled = undo.length === 0;
    lastMove = {key: "", at: 0};
    if (last !== undefined) ask({address: last});
  });
  byId("preset").addEventListener("change", (event) => {
    if (!event.target.value) return;
    remember("preset");
    wanted.clear();
    ask({preset: event.target.value});
    event.target.value = "";
  });
  byId("file").addEventListener("change", async (event) => {
    const [file] = event.target.files, largest = Number(event.target.dataset.largest);
    if (!file) return;
    if (file.size > largest) {
      alarm(`${file.name} has ${Math.ceil(file.size / 1000)} kB and was not opened: a servo file, or a file with a ` +
        `loop of parts, has at most ${largest / 1000} kB.`);
    } else {
      remember("file");
      wanted.clear();
      ask({file: await file.text()});
    }
    event.target.value = "";
  });
  byId("controls").addEventListener("submit", (event) => event.preventDefault());

  // Beginning ----------------------------------------------------------------------------------------------------
  const connect = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/answers`);
    let greeted = false;
    socket.addEventListener("open", () => { greeted = true; alarm(""); rebuild = true; ask({}); });
    socket.addEventListener("message", (event) => heard(JSON.parse(event.data)));
    socket.addEventListener("close", (event) => {
      byId("busy").hidden = true;
      if (event.code !== 1013) alarm("The server has stopped: what is shown stays as it is, and moves have no effect. " +
        "Start it again with casahunt explore; the page goes on by itself.");
      setTimeout(connect, AGAIN);
    });
  };
  if (frozen) {
    document.body.classList.add("frozen");
    n = frozen.n;
    for (const message of frozen.messages) heard(message);
    alarm("");
  } else connect();
  embed();
})();
