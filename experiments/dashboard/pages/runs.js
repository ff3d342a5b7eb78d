// All runs below the folders that are served, polled.
"use strict";
(() => {
  const { element } = segsim;
  const list = document.getElementById("runs");
  const problems = document.getElementById("problems");

  const card = (run) => {
    const address = `/run.html?run=${encodeURIComponent(run.key)}`;
    return element("section", { class: "card" },
      element("h2", {}, element("a", { href: address }, run.title), ...segsim.badges(run)),
      ...segsim.progress_block(run),
      segsim.arm_rows(run),
      segsim.pair_line(run),
      element("p", { class: "faint" }, `${run.scenes.map((scene) => scene.title).join(", ")} · begun ${run.started.replace("T", " ").replace("Z", " UTC")}`,
        element("br"), run.folder));
  };

  segsim.repeat(async () => {
    const all = await segsim.get_json("/api/runs");
    list.replaceChildren(...all.runs.map(card));
    if (all.runs.length === 0) {
      list.replaceChildren(element("p", { class: "faint" },
        "No run yet. A run appears here when its first trial may begin: scenes and detectors are prepared before."));
    }
    problems.replaceChildren(...all.problems.map((text) => element("p", { class: "note" }, text)));
    segsim.ready();
  }, 2000);
})();
