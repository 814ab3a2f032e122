// A page without us, from which frames are counted: it shows nothing, or draws one canvas of a plot's size each 94 ms,
// as the live view does.
(drawn) => {
  const context = Object.assign(document.createElement("canvas"), { width: 734, height: 150 }).getContext("2d");
  if (drawn) {
    document.body.append(context.canvas);
    let count = 0;
    setInterval(() => {
      context.clearRect(0, 0, 734, 150);
      context.beginPath();
      for (let x = 0; x < 734; x += 1) context.lineTo(x, 75 + 60 * Math.sin((x + 7 * count) / 30));
      count += 1;
      context.stroke();
    }, 94);
  }
  window.times = [];
  requestAnimationFrame(function step(now) {
    window.times.push(now);
    requestAnimationFrame(step);
  });
}
