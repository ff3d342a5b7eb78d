// What moves in the report that `segsim report` writes: plots, filters of trials, layers of maps.
// Every page can be read without it.
"use strict";
(() => {
  const palette = ["#c26a1b", "#1f6fb2", "#3a8f4d", "#8453a8", "#b3261e", "#5f6b76", "#0f8b8d"];
  const percent = (value) => `${Math.round(1000 * value) / 10} %`;

  // Draws the interval of every point that has one.
  const whiskers = {
    id: "whiskers",
    afterDatasetsDraw(chart) {
      const { ctx, scales } = chart;
      chart.data.datasets.forEach((set, index) => {
        if (!set.whiskers || !chart.isDatasetVisible(index)) return;
        const points = chart.getDatasetMeta(index).data;
        ctx.save();
        ctx.strokeStyle = set.borderColor;
        ctx.lineWidth = 2;
        set.whiskers.forEach(([low, high], k) => {
          const point = points[k];
          const scale = set.along === "x" ? scales.x : scales.y;
          const a = scale.getPixelForValue(low);
          const b = scale.getPixelForValue(high);
          ctx.beginPath();
          if (set.along === "x") {
            ctx.moveTo(a, point.y);
            ctx.lineTo(b, point.y);
            for (const x of [a, b]) {
              ctx.moveTo(x, point.y - 5);
              ctx.lineTo(x, point.y + 5);
            }
          } else {
            ctx.moveTo(point.x, a);
            ctx.lineTo(point.x, b);
            for (const y of [a, b]) {
              ctx.moveTo(point.x - 5, y);
              ctx.lineTo(point.x + 5, y);
            }
          }
          ctx.stroke();
        });
        ctx.restore();
      });
    },
  };

  const share_axis = (text) => ({
    min: 0,
    max: 1,
    title: { display: true, text },
    ticks: { callback: percent },
  });
  const number_axis = (text) => ({ type: "linear", beginAtZero: true, title: { display: true, text } });
  const color_of = (series, index) => series.color || palette[index % palette.length];

  const kinds = {
    intervals: (plot) => ({
      type: "scatter",
      data: {
        labels: plot.rows.map((row) => row.label),
        datasets: plot.series.flatMap((series, index) => {
          const rows = plot.rows.filter((row) => row.series === series.name);
          const color = color_of(series, index);
          const rates = {
            label: series.name,
            data: rows.map((row) => ({ x: row.value, y: row.label })),
            whiskers: rows.map((row) => [row.low, row.high]),
            along: "x",
            borderColor: color,
            backgroundColor: color,
            pointRadius: 6,
            clip: false,
          };
          const dots = rows.flatMap((row) => (row.dots ?? []).map((x) => ({ x, y: row.label })));
          if (dots.length === 0) return [rates];
          const trainings = {
            label: `${series.name}, each training`,
            data: dots,
            borderColor: color,
            backgroundColor: "#ffffff",
            borderWidth: 1.5,
            pointRadius: 4,
            clip: false,
          };
          return [trainings, rates];  // The first is drawn on top.
        }),
      },
      options: {
        scales: {
          x: share_axis(plot.x),
          y: {
            type: "category",
            offset: true,
            labels: plot.rows.map((row) => row.label),
            ticks: { autoSkip: false },
          },
        },
      },
    }),
    bars: (plot) => ({
      type: "bar",
      data: {
        labels: plot.labels,
        datasets: plot.series.map((series, index) => ({
          label: series.name,
          data: series.values,
          backgroundColor: color_of(series, index),
        })),
      },
      options: {
        indexAxis: plot.horizontal ? "y" : "x",
        scales: plot.horizontal
          ? { x: { ...number_axis(plot.x), ticks: { precision: 0 } } }
          : { x: { title: { display: true, text: plot.x } }, y: { ...number_axis(plot.y), ticks: { precision: 0 } } },
      },
    }),
    lines: (plot) => ({
      type: "scatter",
      data: {
        datasets: plot.series.map((series, index) => ({
          label: series.name,
          data: series.points.map((point) => ({ x: point[0], y: point[1] })),
          whiskers: series.points[0] && series.points[0].length > 2
            ? series.points.map((point) => [point[2], point[3]]) : undefined,
          along: "y",
          showLine: true,
          stepped: plot.stepped ? "before" : false,
          borderColor: color_of(series, index),
          backgroundColor: color_of(series, index),
          pointRadius: plot.stepped ? 0 : 4,
          borderWidth: 2,
        })),
      },
      options: { scales: { x: number_axis(plot.x), y: share_axis(plot.y) } },
    }),
  };

  for (const figure of document.querySelectorAll("figure[data-plot]")) {
    const canvas = figure.querySelector("canvas");
    if (!canvas || !window.Chart) continue;
    const plot = JSON.parse(figure.querySelector("script").textContent);
    const chart = kinds[plot.kind](plot);
    if (plot.rows) canvas.parentElement.style.height = `${Math.max(260, 120 + 20 * plot.rows.length)}px`;
    chart.options = {
      animation: false,
      responsive: true,
      maintainAspectRatio: false,
      ...chart.options,
      plugins: { legend: { display: plot.series.length > 1, position: "bottom" } },
    };
    chart.plugins = [whiskers];
    new window.Chart(canvas, chart);
    figure.dataset.drawn = "1";
  }

  // The list of trials, narrowed to what the address asks for: trials.html#arm=after&success=0
  const list = document.getElementById("trials");
  if (list) {
    const rows = [...list.tBodies[0].rows];
    const selects = [...document.querySelectorAll(".filters select")];
    const count = document.getElementById("count");
    const wanted = () => {
      const filter = new URLSearchParams(location.hash.slice(1).replaceAll("+", "%2B"));
      return [...filter.entries()];
    };
    const show = () => {
      const filter = wanted();
      let shown = 0;
      for (const row of rows) {
        row.hidden = !filter.every(([key, value]) => (row.dataset[key] ?? "") === value);
        shown += row.hidden ? 0 : 1;
      }
      count.textContent = `${shown} of ${rows.length} trials`;
      for (const select of selects) {
        select.value = filter.find(([key]) => key === select.name)?.[1] ?? "";
      }
    };
    for (const select of selects) {
      const values = [...new Set(rows.map((row) => row.dataset[select.name]))].sort();
      for (const value of values) select.add(new Option(value || "(none)", value));
      select.options[0].value = "";
      select.addEventListener("change", () => {
        const filter = wanted().filter(([key]) => key !== select.name);
        if (select.value) filter.push([select.name, select.value]);
        location.hash = filter.map(([key, value]) => `${key}=${encodeURIComponent(value)}`).join("&");
      });
    }
    document.getElementById("all").addEventListener("click", () => { location.hash = ""; });
    window.addEventListener("hashchange", show);
    show();
  }

  // Maps: one arm at a time, causes on and off.
  for (const map of document.querySelectorAll(".maps")) {
    const arm = map.querySelector("select");
    const boxes = [...map.querySelectorAll("input[type=checkbox]")];
    const update = () => {
      const causes = new Set(boxes.filter((box) => box.checked).map((box) => box.value));
      for (const path of map.querySelectorAll("svg a")) {
        const hidden = (arm.value && path.dataset.arm !== arm.value) || !causes.has(path.dataset.cause);
        path.style.display = hidden ? "none" : "";
      }
    };
    arm.addEventListener("change", update);
    for (const box of boxes) box.addEventListener("change", update);
    update();
  }
  document.documentElement.dataset.ready = "1";
})();
