// The slider of the report: draws the scope over the two pictures at any recorded step.
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("motion").textContent);
  var viewer = document.getElementById("viewer");
  var slider = document.getElementById("depth");
  var play = document.getElementById("play");
  var tightestButton = document.getElementById("tightest");
  var readout = document.getElementById("readout");
  var strip = document.getElementById("strip");
  var panels = Array.prototype.slice.call(viewer.querySelectorAll(".panel canvas"));
  var introducer = -32768;

  function unpack(text) {
    var raw = atob(text);
    var view = new DataView(new ArrayBuffer(raw.length));
    for (var i = 0; i < raw.length; i++) view.setUint8(i, raw.charCodeAt(i));
    var out = new Int16Array(raw.length / 2);
    for (var k = 0; k < out.length; k++) out[k] = view.getInt16(2 * k, true);
    return out;
  }

  var clearance = unpack(data.clearance);
  data.views.forEach(function (view) { view.points = unpack(view.joints); });
  var tightest = 0;
  data.smallest.forEach(function (value, k) {
    var best = data.smallest[tightest];
    if (value !== null && (best === null || value < best)) tightest = k;
  });

  function color(value) {
    var scale = data.scale;
    var f = (value - scale.low) / (scale.high - scale.low);
    var n = scale.colors.length;
    return scale.colors[Math.max(0, Math.min(n - 1, Math.floor(f * n)))];
  }

  function signed(value, digits) {
    return value.toFixed(digits).replace("-", "\u2212");
  }

  function prepare(canvas) {
    var ratio = window.devicePixelRatio || 1;
    var box = canvas.getBoundingClientRect();
    var w = Math.max(1, Math.round(box.width * ratio)), h = Math.max(1, Math.round(box.height * ratio));
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    var ink = canvas.getContext("2d");
    ink.setTransform(1, 0, 0, 1, 0, 0);
    ink.clearRect(0, 0, w, h);
    ink.scale(ratio, ratio);
    return { ink: ink, width: box.width, height: box.height };
  }

  function drawScope(canvas, view, k) {
    var area = prepare(canvas), ink = area.ink;
    var px = area.width / view.width;
    var count = data.joints, base = 2 * k * count;
    function x(j) { return view.points[base + 2 * j] * 0.1 * px; }
    function y(j) { return view.points[base + 2 * j + 1] * 0.1 * px; }
    var width = Math.max(3, 2 * data.radius * px);
    function line(j, style, wide) {
      ink.beginPath(); ink.moveTo(x(j), y(j)); ink.lineTo(x(j + 1), y(j + 1));
      ink.strokeStyle = style; ink.lineWidth = wide; ink.stroke();
    }
    function value(j) { return clearance[k * (count - 1) + j]; }
    var j;
    ink.lineCap = "butt";
    for (j = count - 2; j >= 0; j--) if (value(j) === introducer) line(j, "rgba(123,138,153,.6)", 0.55 * width);
    ink.lineCap = "round";
    for (j = count - 2; j >= 0; j--) if (value(j) !== introducer) line(j, "#05080c", width + 2.5);
    for (j = count - 2; j >= 0; j--) if (value(j) !== introducer) line(j, color(value(j) * 0.01), width);
    ink.beginPath(); ink.arc(x(0), y(0), Math.max(4, 0.56 * width), 0, 7);
    ink.fillStyle = "#fff"; ink.fill(); ink.lineWidth = 1.5; ink.strokeStyle = "#05080c"; ink.stroke();
    data.spots[k].forEach(function (s) {
      [["#05080c", 4], ["#fff", 2]].forEach(function (pen) {
        ink.beginPath();
        ink.arc((x(s) + x(s + 1)) / 2, (y(s) + y(s + 1)) / 2, 0.5 * width + 8, 0, 7);
        ink.strokeStyle = pen[0]; ink.lineWidth = pen[1]; ink.stroke();
      });
    });
  }

  // The strip keeps the slider's own travel, so that its line stands under the thumb.
  var thumb = 9;
  function drawStrip(k) {
    var area = prepare(strip), ink = area.ink, w = area.width, h = area.height;
    var known = data.smallest.filter(function (v) { return v !== null; });
    if (!known.length) return;
    var low = Math.min(0, Math.min.apply(null, known));
    var sorted = known.slice().sort(function (a, b) { return a - b; });
    var high = Math.max(0.5, 1.3 * sorted[Math.floor(0.9 * (sorted.length - 1))]);
    function x(i) { return thumb + (w - 2 * thumb) * (data.count > 1 ? i / (data.count - 1) : 0); }
    function y(v) { return h - 5 - (h - 10) * (Math.min(v, high) - low) / (high - low); }
    ink.strokeStyle = "#5b6b7a"; ink.lineWidth = 1;
    ink.beginPath(); ink.moveTo(thumb, y(0)); ink.lineTo(w - thumb, y(0)); ink.stroke();
    ink.lineCap = "round"; ink.lineWidth = 2;
    for (var i = 0; i + 1 < data.count; i++) {
      var a = data.smallest[i], b = data.smallest[i + 1];
      if (a === null || b === null) continue;
      ink.strokeStyle = color(Math.min(a, b));
      ink.beginPath(); ink.moveTo(x(i), y(a)); ink.lineTo(x(i + 1), y(b)); ink.stroke();
    }
    ink.strokeStyle = "#fff"; ink.lineWidth = 1.5;
    ink.beginPath(); ink.moveTo(x(k), 0); ink.lineTo(x(k), h); ink.stroke();
  }

  function show(k) {
    k = Math.max(0, Math.min(data.count - 1, k));
    slider.value = k;
    panels.forEach(function (canvas, i) { drawScope(canvas, data.views[i], k); });
    drawStrip(k);
    var depth = data.insertion[k].toFixed(1) + " mm";
    var v = data.smallest[k];
    var text = v === null ? "all in the introducer"
      : signed(v, 2) + " mm at " + data.place[k].toFixed(0) + " mm";
    document.getElementById("at-depth").textContent = depth;
    document.getElementById("at-clearance").textContent = text;
    document.getElementById("at-step").textContent = data.steps[k];
    readout.classList.toggle("through", v !== null && v < 0);
    slider.setAttribute("aria-valuetext", depth + " inserted, clearance " + text);
  }

  var timer = null, from = 0, began = 0;
  function stop() {
    if (timer) cancelAnimationFrame(timer);
    timer = null; play.textContent = "\u25B6 Play"; play.setAttribute("aria-pressed", "false");
  }
  function tick(now) {
    if (!began) began = now;
    var k = from + Math.floor((now - began) * data.count / 9000);
    show(k);
    if (k >= data.count - 1) stop(); else timer = requestAnimationFrame(tick);
  }
  play.addEventListener("click", function () {
    if (timer) { stop(); return; }
    from = +slider.value >= data.count - 1 ? 0 : +slider.value;
    began = 0; play.textContent = "\u275A\u275A Pause"; play.setAttribute("aria-pressed", "true");
    timer = requestAnimationFrame(tick);
  });
  slider.addEventListener("input", function () { stop(); show(+slider.value); });
  slider.addEventListener("keydown", function (event) {
    if (event.key === " ") { event.preventDefault(); play.click(); }
  });
  tightestButton.addEventListener("click", function () { stop(); show(tightest); slider.focus(); });
  strip.addEventListener("click", function (event) {
    var box = strip.getBoundingClientRect();
    var f = (event.clientX - box.left - thumb) / Math.max(1, box.width - 2 * thumb);
    stop(); show(Math.round(f * (data.count - 1)));
  });
  window.addEventListener("resize", function () { show(+slider.value); });
  window.addEventListener("load", function () { show(+slider.value); });
  viewer.hidden = false;
  slider.max = data.count - 1;
  show(tightest);
})();
