// The bar below a replay, its keys, and what it shows: run by replay.py's file once k3d has loaded the scene.
// k3d's own menu has no legend with a unit, and knows time but by the numbers of frames.
const S = $settings;
const K = K3DInstance;
const last = S.times.length - 1;

const bar = document.createElement('div');
bar.style.cssText = 'position:absolute;left:0;right:0;bottom:0;padding:8px 12px;display:flex;gap:10px;z-index:10;' +
  'align-items:center;white-space:nowrap;font:14px sans-serif;color:#222;background:rgba(255,255,255,0.85)';
const title = document.createElement('div');
title.textContent = S.title;
title.style.cssText = 'position:absolute;left:12px;top:8px;z-index:10;font:16px sans-serif;color:#222';
document.body.append(title, bar);

function add(tag, properties) {
  const element = Object.assign(document.createElement(tag), properties);
  bar.appendChild(element);
  return element;
}

const play = add('button', {textContent: 'play', title: 'space'});
const slider = add('input', {type: 'range', min: 0, max: last, step: 1, value: 0, title: 'left, right'});
slider.style.cssText = 'flex:1;min-width:3em';
const clock = add('span', {});
clock.style.cssText = 'min-width:9em;font-variant-numeric:tabular-nums';
const speed = add('select', {title: 'speed'});
for (const x of S.speeds) speed.add(new Option(x + ' x', x, x === S.speed, x === S.speed));

function showContacts(wanted) {
  const object = K.getWorld().ObjectsListJson[S.contacts];
  object.visible = wanted;
  K.reload(object, {visible: wanted}, true);
  K.render();
}

// Positions of the camera. It is set for images as wide as S.aspect; in a narrower window it goes back.
function look(from) {
  const back = Math.max(1, S.aspect * innerHeight / innerWidth);
  const [position, target, up] = [0, 3, 6].map(at => from.slice(at, at + 3));
  K.setCamera([...target.map((x, i) => x + back * (position[i] - x)), ...target, ...up]);
  K.render();
}

if (S.closer !== null) {
  const views = add('select', {title: 'what is looked at'});
  for (const name of ['whole', 'closer']) views.add(new Option(name, name));
  views.onchange = () => look(views.value === 'closer' ? S.closer : S.camera);
}

let contacts = null;
if (S.contacts !== null) {
  const label = add('label', {textContent: ' contact forces'});
  contacts = Object.assign(document.createElement('input'), {type: 'checkbox'});
  label.prepend(contacts);
  contacts.onchange = () => showContacts(contacts.checked);
}

const legend = add('span', {title: 'colour of the tendons'});
legend.innerHTML = 'tension&nbsp; 0 <span style="display:inline-block;width:90px;height:10px;background:' +
  'linear-gradient(to right,' + S.colors[0] + ',' + S.colors[1] + ')"></span> ' + S.full + ' N';

let frame = -1;
let start = null; // {time [s] of the run, now [ms]} when it began to play; null: it stands

function show(k) {
  if (k === frame) return Promise.resolve();
  frame = k;
  slider.value = k;
  clock.textContent = S.times[k].toFixed(3) + ' / ' + S.times[last].toFixed(3) + ' s';
  return K.setTime(k);
}

function frameAt(time) {
  let k = 0;
  while (k < last && S.times[k + 1] <= time + 1e-9) k++;
  return k;
}

function tick(now) {
  if (start === null) return;
  show(frameAt(start.time + (now - start.now) / 1000 * speed.value)).then(() => {
    if (start === null) return;
    if (frame === last) start = {time: S.times[0], now: performance.now()};
    requestAnimationFrame(tick);
  });
}

function resume() {
  start = {time: S.times[frame === last ? 0 : frame], now: performance.now()};
}

function stop() {
  start = null;
  play.textContent = 'play';
}

function toggle() {
  if (start !== null) {
    stop();
    return;
  }
  resume();
  play.textContent = 'pause';
  requestAnimationFrame(tick);
}

play.onclick = toggle;
speed.onchange = () => {
  if (start !== null) resume();
};
slider.oninput = () => {
  stop();
  show(+slider.value);
};
addEventListener('keydown', event => {
  const by = {ArrowRight: 1, ArrowLeft: -1}[event.key];
  if (event.key === ' ') {
    event.preventDefault();
    toggle();
  } else if (by) {
    event.preventDefault();
    stop();
    show(Math.min(last, Math.max(0, frame + by)));
  }
});

// For scripts; camera: where it is [mm].
window.replay = {show: time => show(frameAt(time)), times: S.times, camera: () => K.getWorld().camera.position.toArray()};
const wish = new URLSearchParams(location.hash.slice(1));
show(frameAt(+(wish.get('t') || S.times[0]))).then(() => {
  if (wish.has('contacts') && contacts !== null) contacts.click();
  look(S.camera);
  document.body.dataset.ready = '1';
});
