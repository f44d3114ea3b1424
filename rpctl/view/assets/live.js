/* A simulation's motion, as it comes: the robot, its ghost, the status line and the charts. The
   page is { show(base, values), ghost(base, values), extend(base), clear() }. */
function makeLive(data, page) {
  const $ = (id) => document.getElementById(id);
  const { stream, stop, charts } = data.live;
  const curves = makeLiveCharts(charts, $("live-charts"));
  let duration = data.live.duration, frame = null, ghost = null, time = null, told = false;
  let finish = () => {};
  curves.begin(duration ?? 1);
  $("stop").addEventListener("click", () => { $("stop").disabled = true; post(stop, null); });
  if (data.live.go) $("stop").textContent = "Stop";
  if (duration !== null) running(true);
  listen();
  return { post, say, begin, running, onEnd: (then) => { finish = then; }, time: () => time };

  function say(text, bad = false) {
    $("status").hidden = !text;
    $("status").textContent = text;
    $("status").classList.toggle("bad", bad);
    told = true;
  }

  function running(on) {
    $("live").hidden = false;
    $("stop").disabled = !on;
    $("stop").hidden = !on;
  }

  /* Send a request to the server, and show a refusal. Return whether it was granted. */
  async function post(path, value) {
    try {
      const answer = await fetch(path, { method: "POST", body: JSON.stringify(value),
        headers: { "Content-Type": "application/json" } });
      if (!answer.ok) say(await answer.text() || `The server refused the request (status ${answer.status})`, true);
      return answer.ok;
    } catch {
      say("The server does not answer: rpctl may have been stopped.", true);
      return false;
    }
  }

  /* A motion begins: its duration (s). */
  function begin(seconds) {
    duration = seconds;
    [frame, ghost, time] = [null, null, null];
    page.clear();
    curves.begin(seconds);
    running(true);
  }

  function listen() {
    const source = new EventSource(stream);
    const on = (kind, act) => source.addEventListener(kind, (event) => act(JSON.parse(event.data)));
    if (duration !== null) say("Connecting…");
    on("state", (text) => say(text));
    on("begin", (each) => { begin(each.duration); page.begin(each); });
    on("frame", ([t, count, ...rest]) => {
      [time, told] = [t, false];
      frame = rest.slice(0, count);
      ghost = rest.slice(count);
      page.extend(frame.slice(0, 3));
    });
    on("figures", ([t, ...values]) => curves.add(t, values));
    on("end", ({ text, bad }) => { draw(); running(false); say(text, bad); finish(); });
    on("done", () => { source.close(); location.reload(); });
    source.addEventListener("error", () => {
      if (duration !== null) say("Disconnected: the simulation has ended or was stopped. Reconnecting…");
    });
    const loop = () => { requestAnimationFrame(loop); draw(); };
    loop();
  }

  function draw() {
    if (!frame) return;
    page.ghost(ghost.slice(0, 3), ghost.slice(3));
    page.show(frame.slice(0, 3), frame.slice(3));
    window.rpctl.time = time;
    if (!told) { say(`${time.toFixed(1)} of ${Number(duration.toFixed(1))} s · ${away(frame, ghost)}`); told = false; }
    frame = null;
  }

  /* How far P is from its reference. */
  function away(actual, desired) {
    const [px, py] = data.point;
    const place = ([x, y, angle]) => [x + Math.cos(angle) * px - Math.sin(angle) * py,
      y + Math.sin(angle) * px + Math.cos(angle) * py];
    const [a, b] = [place(actual), place(desired)];
    return `base error ${(1000 * Math.hypot(a[0] - b[0], a[1] - b[1])).toFixed(1)} mm`;
  }
}
