// A finished trial, tick by tick.
"use strict";
(async () => {
  const { element, run_address, fixed } = segsim;
  const node = (id) => document.getElementById(id);
  const key = segsim.parameters.get("run") || "", id = segsim.parameters.get("trial") || "";
  const slider = node("tick");
  // Columns of a tick.
  const kTime = 0, kX = 1, kY = 2, kYaw = 3, kForward = 4, kTurn = 5, kMode = 6, kContact = 7, kPixels = 8, kDistance = 9;
  let trial = null, floor = null, course = null, playing = null, wanted = null, busy = false;

  const tick = () => Number(slider.value);

  const show_state = () => {
    const t = trial.ticks[tick()];
    const seen = trial.detections.filter((d) => d[0] === tick());
    segsim.fill(node("state"),
      element("b", { class: `mode-${t[kMode]}` }, segsim.modes[t[kMode]]),
      element("span", {}, `tick ${tick()} of ${trial.ticks.length - 1}`), element("span", {}, `${fixed(t[kTime], 1)} s`),
      element("span", {}, `${fixed(t[kForward], 2)} m/s, ${fixed(t[kTurn], 2)} rad/s`),
      element("span", {}, t[kDistance] === null ? "off the floor" : `${fixed(t[kDistance], 2)} m to go`),
      element("span", {}, t[kPixels] > 0 ? `goal in view: ${t[kPixels]} px` : "goal not in view"),
      element("span", {}, seen.length === 0 ? "nothing detected" : `detected: ${seen.map((d) => `${d[1].toFixed(2)} ${d[6] ? "(true)" : "(false)"}`).join(", ")}`),
      t[kContact] ? element("b", { class: "error" }, "contact") : null);
    node("where").textContent = `${fixed(t[kTime], 1)} s`;
  };

  const show_map = () => {
    const k = tick(), t = trial.ticks[k];
    floor_map.draw(node("map"), {
      floor, goal_class: trial.goal_class, goal_instances: trial.goal_instances, way: trial.way, view_points: trial.view_points,
      path: trial.ticks.slice(0, k + 1).map((row) => [row[kX], row[kY], row[kMode]]),
      start: trial.start, pose: [t[kX], t[kY], t[kYaw]] });
  };

  const show_boxes = () => floor_map.draw_boxes(node("boxes"), trial.camera, trial.detections.filter((d) => d[0] === tick())
    .map((d) => [trial.goal_class, d[1], d[2], d[3], d[4], d[5], d[6]]));

  // One pair of images at a time: while one is drawn, only the newest wish is kept.
  const show_images = async () => {
    wanted = tick();
    if (busy) return;
    busy = true;
    while (wanted !== null) {
      const k = wanted;
      wanted = null;
      try {
        const images = await Promise.all(["camera", "panoptic"].map((which) =>
          segsim.image(run_address(key, "trials", id, which, `${k}.jpg`))));
        [node("camera").src, node("panoptic").src] = images.map((image) => image.src);
        node("camera").dataset.tick = k;
        node("status").textContent = "";
      } catch (error) {
        await segsim.get(run_address(key, "trials", id, "camera", `${k}.jpg`)).catch((why) => { node("status").textContent = why.message; });
      }
    }
    busy = false;
  };

  const show = () => {
    show_state();
    show_map();
    if (course) course.draw();
    show_images();
    history.replaceState(null, "", `#${tick()}`);
  };
  const go = (k) => {
    slider.value = Math.min(trial.ticks.length - 1, Math.max(0, k));
    show();
  };

  const play = () => {
    if (playing) {
      clearInterval(playing);
      playing = null;
    } else {
      if (tick() + 1 >= trial.ticks.length) go(0);
      playing = setInterval(() => {
        if (busy) return;
        if (tick() + 1 >= trial.ticks.length) return play();
        go(tick() + 1);
      }, 100);
    }
    node("play").textContent = playing ? "pause" : "play";
  };

  const draw_course = () => {
    if (!window.Chart) {
      node("course").parentElement.textContent = "No chart: the machine has no libjs-chart.js.";
      return;
    }
    const cursor = {
      id: "cursor",
      afterDatasetsDraw({ ctx, scales, chartArea }) {
        const x = scales.x.getPixelForValue(trial.ticks[tick()][kTime]);
        ctx.save();
        ctx.strokeStyle = "#22262b";
        ctx.beginPath();
        ctx.moveTo(x, chartArea.top);
        ctx.lineTo(x, chartArea.bottom);
        ctx.stroke();
        ctx.restore();
      },
    };
    course = new window.Chart(node("course"), {
      type: "line",
      data: { datasets: [
        { label: "distance to the goal [m]", yAxisID: "y", data: trial.ticks.map((t) => ({ x: t[kTime], y: t[kDistance] })), borderColor: "#1f6fb2", backgroundColor: "#1f6fb2", pointRadius: 0, borderWidth: 2 },
        { label: "goal in view [px]", yAxisID: "pixels", data: trial.ticks.map((t) => ({ x: t[kTime], y: t[kPixels] })), borderColor: "#3a8f4d", backgroundColor: "#3a8f4d33", fill: true, pointRadius: 0, borderWidth: 1 }] },
      options: { animation: false, responsive: true, maintainAspectRatio: false, parsing: true,
        plugins: { legend: { position: "bottom" }, tooltip: { enabled: false } },
        onClick: (event) => {
          const time = course.scales.x.getValueForPixel(event.x);
          go(trial.ticks.reduce((best, t, k) => (Math.abs(t[kTime] - time) < Math.abs(trial.ticks[best][kTime] - time) ? k : best), 0));
        },
        scales: { x: { type: "linear", max: trial.ticks[trial.ticks.length - 1][kTime], title: { display: true, text: "simulated time [s]" } },
          y: { beginAtZero: true, title: { display: true, text: "m" } },
          pixels: { position: "right", beginAtZero: true, grid: { drawOnChartArea: false }, title: { display: true, text: "px" } } } },
      plugins: [cursor],
    });
  };

  const show_head = () => {
    const t = trial.trial;
    const pages = `run=${encodeURIComponent(key)}`;
    document.title = `${t.episode}, ${t.arm}`;
    node("title").textContent = `Find ${segsim.with_article(trial.goal_class)} in ${trial.scene_title}`;
    node("result").replaceChildren(
      element("b", { class: t.success ? "success" : "failure" }, segsim.words(t.outcome)), t.success || !t.cause ? "" : ` (${segsim.words(t.cause)})`,
      ` · ${t.episode} · arm ${t.arm} · SPL ${fixed(t.spl, 2)} · path ${fixed(t.path_m, 1)} m`);
    node("run").href = `/run.html?${pages}`;
    node("run").textContent = trial.run;
    node("scene").href = `/scene.html?${pages}&trial=${t.id}`;
    node("others").append(...trial.others.filter((other) => other.id !== t.id && other.has_log).flatMap((other) => [
      element("a", { href: `/trial.html?${pages}&trial=${other.id}` },
        `${other.arm}${other.repetition > 0 ? `, repetition ${other.repetition}` : ""}: ${segsim.words(other.outcome)}`), " "]));
    node("moments").append(...trial.moments.map(([k, what]) =>
      element("button", { onclick: () => go(k) }, `${fixed(trial.ticks[k][kTime], 1)} s ${what}`)));
    node("story").textContent = trial.story.join("\n");
  };

  try {
    trial = await segsim.get_json(run_address(key, "trials", id));
  } catch (error) {
    node("status").textContent = error.message;
    return;
  }
  slider.max = trial.ticks.length - 1;
  slider.value = Number(location.hash.slice(1)) || 0;
  show_head();
  draw_course();
  slider.addEventListener("input", show);
  node("play").addEventListener("click", play);
  node("back").addEventListener("click", () => go(tick() - 1));
  node("forward").addEventListener("click", () => go(tick() + 1));
  document.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10, Home: -Infinity, End: Infinity };
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key in steps) {
      go(Math.min(trial.ticks.length, Math.max(0, tick() + steps[event.key] * (event.shiftKey ? 10 : 1))));
    } else if (event.key === " ") {
      play();
    } else {
      return;
    }
    event.preventDefault();
  });
  // The boxes lie over the picture, so they wait until it has its size.
  node("camera").addEventListener("load", () => { if (Number(node("camera").dataset.tick) === tick()) show_boxes(); });
  window.addEventListener("resize", () => { show_map(); show_boxes(); });
  show();
  if (trial.scene_number !== null) {
    floor = await floor_map.load(key, trial.scene_number).catch((error) => { node("status").textContent = error.message; return null; });
  }
  show_map();
  segsim.ready();
})();
