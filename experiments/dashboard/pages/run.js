// One run: its numbers, what a chosen worker sees, its trials.
"use strict";
(() => {
  const { element, run_address, fixed } = segsim;
  const key = segsim.parameters.get("run") || "";
  const node = (id) => document.getElementById(id);
  const floors = new Map();  // By scene: a floor, or when to ask again.
  let chosen = null, shown_tick = "", offset = 0, total = 0, trials_of = "", strip = null;

  const floor_of = (scenes, name) => {
    const number = scenes.findIndex((scene) => scene.name === name);
    const known = floors.get(name);
    if (number < 0 || (known && (known.image || known.until > Date.now()))) return known && known.image ? known : null;
    floors.set(name, { until: Date.now() + 15000 });
    floor_map.load(key, number).then((floor) => floors.set(name, floor), () => {});
    return null;
  };

  const stages = [["other", "#c9ced4"], ["render", "#1f6fb2"], ["detect", "#c26a1b"], ["policy", "#3a8f4d"]];
  const draw_strip = (rows) => {
    if (!window.Chart) {
      node("strip").parentElement.textContent = "No chart: the machine has no libjs-chart.js.";
      return;
    }
    if (!strip) {
      strip = new window.Chart(node("strip"), {
        type: "line",
        data: { labels: [], datasets: stages.slice().reverse().map(([label, color]) => ({
          label, data: [], borderColor: color, backgroundColor: `${color}99`, fill: "stack", pointRadius: 0, borderWidth: 1.5 })) },
        options: { animation: false, responsive: true, maintainAspectRatio: false,
          interaction: { mode: "index", intersect: false },
          plugins: { legend: { position: "right", labels: { boxWidth: 12 } } },
          scales: { x: { title: { display: true, text: "tick" }, ticks: { maxTicksLimit: 12, maxRotation: 0 } },
            y: { stacked: true, beginAtZero: true, title: { display: true, text: "ms" } } } },
      });
    }
    const fresh = rows.filter((row) => row[0] > 0);
    const data = {
      render: fresh.map((row) => row[2]), detect: fresh.map((row) => row[3]), policy: fresh.map((row) => row[4]),
      other: fresh.map((row) => Math.max(0, row[1] - row[2] - row[3] - row[4])),
    };
    strip.data.labels = fresh.map((row) => row[0]);
    for (const set of strip.data.datasets) set.data = data[set.label];
    strip.update();
  };

  const show_worker = async (run, live) => {
    const { trial, tick } = live;
    const stamp = `${live.worker} ${trial.episode} ${trial.arm} ${trial.repetition} ${tick.index}`;
    segsim.fill(node("state"),
      element("b", {}, `find ${segsim.with_article(trial.goal_class)}`), element("span", {}, trial.scene_title), element("span", {}, trial.episode),
      element("span", {}, `arm: ${trial.arm}`), element("b", { class: `mode-${mode_number(tick.mode)}` }, segsim.modes[mode_number(tick.mode)]),
      element("span", {}, `tick ${tick.index}, ${fixed(tick.time_s, 1)} of ${fixed(trial.time_limit_s, 0)} s`),
      element("span", {}, `${fixed(tick.command[0], 2)} m/s, ${fixed(tick.command[1], 2)} rad/s`),
      tick.contact ? element("b", { class: "error" }, "contact") : null,
      live.age_s > 5 ? element("span", { class: "note" }, `${segsim.duration(live.age_s)} old`) : null);
    if (stamp === shown_tick) return;
    const names = live.parts.map((part) => part[0]);
    const part = (name) => (names.includes(name)
      ? segsim.image(`${run_address(key, "workers", live.worker, name)}?tick=${encodeURIComponent(stamp)}`) : Promise.resolve(null));
    const [camera, panoptic, cells] = await Promise.all(["camera.jpg", "panoptic.jpg", "cells.png"].map(part));
    if (camera) node("camera").src = camera.src;
    if (panoptic) node("panoptic").src = panoptic.src;
    node("worker").classList.remove("hidden");
    floor_map.draw_boxes(node("boxes"), live.camera, live.detections);
    floor_map.draw(node("map"), {
      floor: floor_of(run.scenes, trial.scene), cells: cells ? floor_map.tint(cells) : null, cells_place: live.cells,
      goal_class: trial.goal_class, goal_instances: trial.goal_instances, way: trial.way, path: live.path, frontiers: live.frontiers,
      objects: live.objects, target: live.target, start: trial.start, pose: tick.pose });
    draw_strip(live.stages);
    shown_tick = stamp;
    node("worker").dataset.tick = tick.index;
  };
  const mode_number = (word) => ({ initialize: 0, explore: 1, navigate: 2, recover: 3, stop: 4 })[word] || 0;

  const show_workers = async (run) => {
    node("live").classList.toggle("hidden", run.state === "finished");
    if (!run.live.some((live) => live.worker === chosen)) chosen = run.live.length > 0 ? run.live[0].worker : null;
    node("workers").replaceChildren(...run.live.map((live) => element("button", {
      class: `${live.worker === chosen ? "chosen" : ""} ${live.age_s > 10 ? "old" : ""}`,
      onclick: () => { chosen = live.worker; shown_tick = ""; } }, live.worker)));
    node("nobody").textContent = run.live.length > 0 ? ""
      : run.can_ask ? "No worker shows itself yet. Those at work do so within a few seconds."
        : "This program may not write to the folder of the run, so it cannot ask workers for pictures: touch live/watched there every few seconds.";
    const live = run.live.find((candidate) => candidate.worker === chosen);
    if (live) await show_worker(run, live).catch(() => {});  // A trial may end between two answers.
    else node("worker").classList.add("hidden");
  };

  const trial_row = (trial) => element("tr", {},
    element("td", { class: "number" }, String(trial.id)),
    element("td", {}, trial.has_log
      ? element("a", { href: `/trial.html?run=${encodeURIComponent(key)}&trial=${trial.id}` }, trial.episode) : trial.episode),
    element("td", {}, trial.arm),
    element("td", { class: trial.success ? "success" : "failure" }, segsim.words(trial.outcome)),
    element("td", {}, trial.success ? "" : segsim.words(trial.cause || trial.error)),
    element("td", { class: "number" }, fixed(trial.spl, 2)),
    element("td", { class: "number" }, `${fixed(trial.sim_s, 1)} s`),
    element("td", { class: "number" }, `${fixed(trial.path_m, 1)} m`),
    element("td", { class: "number" }, String(trial.contacts)),
    element("td", {}, trial.has_log
      ? element("a", { href: `/scene.html?run=${encodeURIComponent(key)}&trial=${trial.id}` }, "3-D") : ""));

  const show_trials = async (run) => {
    const stamp = `${run.done} ${run.failed} ${offset}`;
    if (stamp === trials_of) return;
    const page = await segsim.get_json(`${run_address(key, "trials")}?offset=${offset}`);
    total = page.total;
    document.querySelector("#trials tbody").replaceChildren(...page.trials.map(trial_row));
    node("page").textContent = total === 0 ? "none finished yet" : `${offset + 1} to ${offset + page.trials.length} of ${total}, newest first`;
    node("newer").disabled = offset === 0;
    node("older").disabled = offset + page.trials.length >= total;
    trials_of = stamp;
  };
  node("newer").addEventListener("click", () => { offset = Math.max(0, offset - 100); trials_of = ""; });
  node("older").addEventListener("click", () => { if (offset + 100 < total) offset += 100; trials_of = ""; });

  segsim.repeat(async () => {
    const run = await segsim.get_json(run_address(key));
    document.title = run.title;
    node("title").textContent = run.title;
    node("badges").replaceChildren(...segsim.badges(run));
    node("folder").textContent = `${run.folder}, run ${run.run_id}, begun ${run.started.replace("T", " ").replace("Z", " UTC")}`;
    node("progress").replaceChildren(...segsim.progress_block(run));
    node("arms").replaceChildren(segsim.arm_rows(run));
    node("pair").replaceChildren(segsim.pair_line(run));
    node("rule").textContent = `${run.rule}. Intervals: Wilson, 95 %.`;
    await show_trials(run);
    await show_workers(run);
    segsim.ready();
  }, 1000);
})();
