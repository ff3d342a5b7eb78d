// Shared by all pages of the dashboard. Everything from the server becomes text nodes, never markup.
"use strict";
const segsim = (() => {
  const parameters = new URLSearchParams(location.search);

  // element("td", {class: "number", title: "..."}, "text", child, ...)
  const element = (tag, attributes = {}, ...children) => {
    const node = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (value === null || value === undefined || value === false) continue;
      if (name === "onclick") node.addEventListener("click", value);
      else node.setAttribute(name, value === true ? "" : value);
    }
    node.append(...children.filter((child) => child !== null && child !== undefined));
    return node;
  };
  const drawing = (tag, attributes = {}, ...children) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    node.append(...children);
    return node;
  };

  // As replaceChildren(), without what is null.
  const fill = (node, ...children) => node.replaceChildren(...children.filter((child) => child !== null && child !== undefined));

  const get = async (address) => {
    const response = await fetch(address);
    if (!response.ok) {
      const text = await response.json().then((json) => json.error, () => response.statusText);
      throw new Error(text);
    }
    return response;
  };
  const get_json = async (address) => (await get(address)).json();
  const image = (address) => new Promise((resolve, reject) => {
    const picture = new Image();
    picture.onload = () => resolve(picture);
    picture.onerror = () => reject(new Error(`no picture at ${address}`));
    picture.src = address;
  });
  const run_address = (key, ...rest) =>
    ["/api/runs", key, ...rest].map((part, k) => (k ? encodeURIComponent(part) : part)).join("/");

  // Calls `poll` again `every_ms` after it is through; says so when the server is gone. A page
  // that nobody looks at waits.
  const repeat = (poll, every_ms) => {
    const status = document.getElementById("status");
    const again = async () => {
      if (!document.hidden) {
        try {
          await poll();
          status.textContent = "";
          document.documentElement.dataset.polls = Number(document.documentElement.dataset.polls || 0) + 1;
        } catch (error) {
          status.textContent = `No answer: ${error.message}. Trying again.`;
        }
      }
      setTimeout(again, every_ms);
    };
    again();
  };

  const percent = (value) => (value === null || value === undefined ? "–" : `${Math.round(100 * value)} %`);
  const points = (value) => `${value >= 0 ? "+" : "−"}${Math.round(100 * Math.abs(value))}`;
  const fixed = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
  const probability = (p) => (p < 0.0001 ? "p < 0.0001" : `p = ${p.toPrecision(2)}`);
  const duration = (seconds) => {
    if (seconds === null || seconds === undefined) return "–";
    const s = Math.round(seconds);
    if (s < 60) return `${s} s`;
    if (s < 3600) return `${Math.floor(s / 60)} min ${s % 60} s`;
    return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
  };
  const words = (name) => name.replaceAll("_", " ");
  const modes = ["look around", "explore", "drive to object", "recover", "stop"];

  const arm_color = (run, name) => {
    const fixed_colors = { before: "#c26a1b", after: "#1f6fb2", oracle: "#3a8f4d" };
    if (run.pair && name === run.pair.before) return "#c26a1b";
    if (run.pair && name === run.pair.after) return "#1f6fb2";
    const others = ["#8453a8", "#5f6b76", "#0f8b8d", "#a23b72", "#6b8e23", "#b3261e"];
    const place = run.arms.findIndex((arm) => arm.name === name);
    return fixed_colors[name] || others[place % others.length];
  };

  // Success rates with their intervals on a scale from 0 to 100 %.
  const arm_rows = (run) => {
    const rows = element("div", { class: "arms" });
    for (const arm of run.arms) {
      const color = arm_color(run, arm.name);
      const svg = drawing("svg", { viewBox: "0 0 100 22", preserveAspectRatio: "none", role: "img" });
      for (const x of [0, 25, 50, 75, 100]) {
        svg.append(drawing("line", { x1: x, x2: x, y1: 2, y2: 20, stroke: "#d9dde2", "vector-effect": "non-scaling-stroke" }));
      }
      if (arm.episodes > 0) {
        const [low, high] = arm.interval.map((share) => 100 * share);
        svg.append(
          drawing("rect", { x: low, y: 7, width: high - low, height: 8, rx: 1, fill: color, "fill-opacity": 0.25 }),
          drawing("line", { x1: 100 * arm.rate, x2: 100 * arm.rate, y1: 3, y2: 19, stroke: color, "stroke-width": 4, "vector-effect": "non-scaling-stroke" }));
      }
      const rate = arm.episodes === 0 ? "no episode yet"
        : `${percent(arm.rate)} [${arm.interval.map((share) => Math.round(100 * share)).join(", ")}]  ${arm.successes}/${arm.episodes}`;
      rows.append(element("span", { class: "name" }, arm.name), svg, element("span", {}, rate));
    }
    rows.append(element("span"), element("span", { class: "scale" }, ...["0", "25", "50", "75", "100 %"].map((text) => element("span", {}, text))), element("span"));
    return rows;
  };

  const pair_line = (run) => {
    if (!run.pair) return element("p", { class: "faint" }, run.arms.length > 1 ? "No episode has been run by both arms yet." : "");
    const pair = run.pair;
    const text = `${pair.after} against ${pair.before} on ${pair.pairs} episodes: ${points(pair.difference)} points ` +
      `[${pair.interval.map(points).join(", ")}], ${pair.gained} gained, ${pair.lost} lost, exact McNemar ${probability(pair.p)}`;
    return element("p", {}, text, run.interim ? element("span", { class: "faint" }, " (not corrected for looking early)") : "");
  };

  const badges = (run) => {
    const list = [element("span", { class: `badge ${run.state}` }, run.state)];
    if (run.interim) {
      list.push(element("span", { class: "badge interim", title: "Trials are missing: rates, intervals and p will still change." }, "interim"));
    }
    return list;
  };

  const progress_block = (run) => {
    const facts = element("div", { class: "facts" });
    const fact = (name, value) => facts.append(element("span", {}, `${name} `, element("b", {}, value)));
    fact("trials", `${run.done} of ${run.planned}`);
    if (run.state === "running") {
      fact("left", run.eta_s === null ? "not known yet" : `about ${duration(run.eta_s)}`);
      fact("workers", run.workers > 0 ? String(run.workers) : "none seen yet");
    }
    if (run.since_last_s !== null && run.state !== "finished") fact("last trial", `${duration(run.since_last_s)} ago`);
    if (run.failed > 0) fact("failed in the harness", String(run.failed));
    return [element("progress", { max: Math.max(1, run.planned), value: run.done }), facts];
  };

  const ready = () => { document.documentElement.dataset.ready = "1"; };

  // Of a trial: all objects of its class, or those that its phrase means.
  const is_goal = (object, trial) => (trial.goal_instances && trial.goal_instances.length
    ? trial.goal_instances.includes(object.id) : object.class === trial.goal_class);
  const with_article = (goal) => (/^(a|an|the) /.test(goal) ? goal : `a ${goal}`);

  return { parameters, element, fill, get, get_json, image, run_address, repeat, percent, fixed, duration, words, modes, arm_rows,
    pair_line, badges, progress_block, ready, is_goal, with_article };
})();
