/* Zoom along time of the figures that say where their time is (data-zoom); without this script they show it all. */
for (const svg of document.querySelectorAll("svg[data-zoom]")) {
  const [left, width, low, high, bottom] = svg.dataset.zoom.split(" ").map(Number);
  const decimal = document.documentElement.lang === "de" ? "," : ".";
  const whole = svg.innerHTML;
  let [from, to] = [low, high];
  const element = (name, attributes, content = "") => {
    const made = document.createElementNS(svg.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.textContent = content;
    return made;
  };
  const across = (time) => left + ((time - from) / (to - from)) * width;
  const timeAt = (event) => {
    const box = svg.getBoundingClientRect();
    const u = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
    return from + (Math.min(Math.max((u - left) / width, 0), 1)) * (to - from);
  };
  const step = () => {
    const least = (to - from) / 8;
    const power = 10 ** Math.floor(Math.log10(least));
    return [1, 2, 2.5, 5, 10].find((m) => m * power >= least * (1 - 1e-9)) * power;
  };
  function show(first, last) {
    const shortest = (high - low) / 200;
    if (last - first < shortest) [first, last] = [(first + last - shortest) / 2, (first + last + shortest) / 2];
    from = Math.max(low, Math.min(first, high - shortest));
    to = Math.min(high, Math.max(last, low + shortest));
    svg.innerHTML = whole;
    if (from === low && to === high) return;
    const scale = (high - low) / (to - from);
    const shift = left - scale * (left + ((from - low) / (high - low)) * width);
    for (const part of svg.querySelectorAll(".along")) part.setAttribute("transform", `matrix(${scale} 0 0 1 ${shift} 0)`);
    const size = step();
    const decimals = Math.max(0, -Math.floor(Math.log10(size) + 1e-9) + (String(size).includes("25") ? 1 : 0));
    const times = [];
    for (let n = Math.ceil(from / size); n * size <= to; n += 1) times.push(n * size);
    for (const marks of svg.querySelectorAll(".marks")) {
      const rules = marks.querySelector("path");
      const [, top, end] = rules?.getAttribute("d")?.match(/M\S+ ([\d.]+)V([\d.]+)/) ?? [];
      if (rules) rules.setAttribute("d", times.map((time) => `M${across(time)} ${top}V${end}`).join(""));
      else
        marks.replaceChildren(
          ...times.map((time) =>
            element(
              "text",
              { x: across(time), y: bottom + 13, "text-anchor": "middle", fill: "var(--muted)" },
              time.toFixed(decimals).replace("-", "\u2212").replace(".", decimal),
            ),
          ),
        );
    }
  }
  let start = null;
  svg.addEventListener("pointerdown", (event) => (start = timeAt(event)));
  svg.addEventListener("pointermove", (event) => {
    if (start === null) return;
    svg.querySelector(".chosen")?.remove();
    const ends = [across(start), across(timeAt(event))].sort((a, b) => a - b);
    const box = { x: ends[0], width: ends[1] - ends[0], y: 0, height: bottom, fill: "var(--law)", "fill-opacity": 0.18 };
    svg.append(element("rect", { class: "chosen", ...box }));
  });
  window.addEventListener("pointerup", (event) => {
    if (start === null) return;
    const ends = [start, timeAt(event)].sort((a, b) => a - b);
    start = null;
    svg.querySelector(".chosen")?.remove();
    if (ends[1] - ends[0] > (to - from) / 100) show(...ends);
  });
  window.addEventListener("pointercancel", () => (start = null)); /* a finger that scrolls the page */
  svg.addEventListener("dblclick", () => show(low, high));
  const size = (factor) => () => show((from + to - (to - from) * factor) / 2, (from + to + (to - from) * factor) / 2);
  const move = (part) => () => {
    const by = Math.min(Math.max(part * (to - from), low - from), high - to);
    show(from + by, to + by);
  };
  const actions = { "−": size(2), "+": size(0.5), "←": move(-0.5), "→": move(0.5), "↔": () => show(low, high) };
  const bar = svg.parentElement.querySelector(".zoom");
  const names = bar.dataset.names.split("|");
  Object.entries(actions).forEach(([sign, act], n) => {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent: sign, title: names[n], ariaLabel: names[n], onclick: act });
    bar.append(button);
  });
  bar.hidden = false;
}
