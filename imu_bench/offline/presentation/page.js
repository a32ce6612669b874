/* SPDX-License-Identifier: Apache-2.0 */
/* Draws each figure when it comes near the screen, the others while the browser is idle, so that
   a page with sixty figures opens at once and still prints complete. */
(function () {
  'use strict';

  /* Where a logarithmic axis has its numbers: at powers of ten, at 1, 2 and 5 where few of those
     are in sight, and in equal steps deep inside of a decade. */
  window.imuBenchTicks = function (data) {
    const low = Math.min(data.range.start, data.range.end);
    const high = Math.max(data.range.start, data.range.end);
    const inside = function (tick) { return tick >= low && tick <= high; };
    if (!(low > 0) || !Number.isFinite(high)) {
      return { major: [], minor: [] };
    }
    if (high < 4 * low) {
      const rough = (high - low) / 5, power = Math.pow(10, Math.floor(Math.log10(rough)));
      const step = power * [1, 2, 5, 10].find(function (n) { return n * power >= rough; });
      const first = Math.ceil(low / step), count = Math.floor(high / step) - first + 1;
      const steps = Array.from({ length: Math.max(0, count) }, function (_, i) {
        return Number(((first + i) * step).toPrecision(12));
      });
      return { major: steps, minor: [] };
    }
    const begin = Math.floor(Math.log10(low)), end = Math.ceil(Math.log10(high));
    const every = Math.ceil((end - begin) / 9);
    const named = high < 100 * low ? [1, 2, 5] : [1];
    const major = [], minor = [];
    for (let exponent = begin; exponent <= end; exponent += 1) {
      for (let digit = 1; digit < 10; digit += 1) {
        const tick = Number(digit + 'e' + exponent);
        const shown = named.includes(digit) && exponent % every === 0;
        (shown ? major : minor).push(tick);
      }
    }
    return { major: major.filter(inside), minor: minor.filter(inside) };
  };

  const waiting = new Map(), drawn = new Map();
  const touch = window.matchMedia('(pointer: coarse)').matches;
  let ready = null;

  /* The library and the figures are compressed: a report must be small enough for a mail. */
  async function unpacked(id) {
    const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), function (c) {
      return c.charCodeAt(0);
    });
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
    return new Response(stream).text();
  }

  async function begin() {
    const script = document.createElement('script');
    script.textContent = await unpacked('packed-library');
    document.body.append(script);
    for (const item of JSON.parse(await unpacked('packed-figures'))) {
      waiting.set(item.target_id, item);
    }
  }

  function old() {
    document.querySelectorAll('.plot').forEach(function (place) {
      place.textContent = 'Figures need a browser of 2023 or later.';
    });
  }

  async function draw(name) {
    await ready;
    const item = waiting.get(name);
    if (item === undefined) {
      return;
    }
    waiting.delete(name);
    const manager = await Bokeh.embed.embed_item(item);
    drawn.set(name, charts(manager));
    if (touch) {
      calm(manager);
    }
  }

  function charts(manager) {
    return Array.from(manager).flatMap(function (view) {
      const parts = view.model.children || [view.model];
      return parts.map(function (part) { return Array.isArray(part) ? part[0] : part; });
    });
  }

  /* Show what was chosen; the legend must not bring back by a click what was not. */
  function choose(button) {
    const figure = button.closest('figure'), choice = button.dataset.choice;
    figure.querySelectorAll('.choice').forEach(function (other) {
      other.setAttribute('aria-pressed', String(other === button));
    });
    for (const chart of drawn.get(figure.querySelector('.plot').id) || []) {
      const seen = chart.renderers.filter(function (one) {
        const tagged = one.tags.length > 0;
        if (tagged) { one.visible = one.tags.includes(choice); }
        return !tagged || one.visible;
      });
      for (const legend of chart.above) {
        for (const entry of legend.items) {
          const named = seen.filter(function (one) {
            return one.name === entry.label.value || entry.renderers.includes(one);
          });
          entry.renderers = named;
          entry.visible = named.length > 0;
        }
      }
    }
  }

  /* A large figure has the page to itself, and the wheel zooms where it would scroll. */
  function enlarge(button) {
    const figure = button.closest('figure');
    const large = figure.classList.toggle('large');
    for (const chart of drawn.get(figure.querySelector('.plot').id) || []) {
      chart.height = Math.round(chart.height * (large ? 1.7 : 1 / 1.7));
      chart.toolbar.tools.forEach(function (tool) {
        if (tool.type === 'WheelZoomTool') { tool.active = large; }
      });
    }
    figure.scrollIntoView({ block: 'nearest' });
  }

  function copy(button) {
    const text = document.getElementById(button.dataset.from).textContent;
    const said = button.textContent;
    function done() {
      button.textContent = 'copied';
      setTimeout(function () { button.textContent = said; }, 1500);
    }
    function byHand() {
      const area = document.createElement('textarea');
      area.value = text;
      document.body.append(area);
      area.select();
      if (document.execCommand('copy')) { done(); }
      area.remove();
    }
    if (navigator.clipboard) {
      navigator.clipboard.writeText(text).then(done, byHand);
    } else {
      byHand();
    }
  }

  /* What the contents point at must be seen. */
  window.addEventListener('hashchange', function () {
    const run = document.querySelector(location.hash + ' > details.run');
    if (run) { run.open = true; }
  });

  document.addEventListener('click', function (event) {
    for (const [kind, act] of [['copy', copy], ['choice', choose], ['enlarge', enlarge]]) {
      const button = event.target.closest('button.' + kind);
      if (button) { act(button); }
    }
  });

  /* On a touch screen a finger must scroll the page, not draw a zoom box. */
  function calm(manager) {
    for (const model of charts(manager)) {
      if (model.toolbar) {
        model.toolbar.tools.forEach(function (tool) {
          if (tool.type === 'BoxZoomTool' || tool.type === 'PanTool') {
            tool.active = false;
          }
        });
      }
    }
  }

  /* One at a time with a pause, so that scrolling stays smooth meanwhile. */
  function next() {
    const name = waiting.keys().next().value;
    if (name !== undefined) {
      draw(name);
      setTimeout(next, 40);
    }
  }

  const near = new IntersectionObserver(function (entries) {
    entries.filter(function (entry) { return entry.isIntersecting; }).forEach(function (entry) {
      near.unobserve(entry.target);
      draw(entry.target.id);
    });
  }, { rootMargin: '600px' });
  ready = begin();
  ready.then(function () {
    document.querySelectorAll('.plot').forEach(function (place) { near.observe(place); });
    setTimeout(next, 200);
  }, old);
  /* On paper four figures share a page; they keep the shape that they have on the screen. */
  const width = 490, height = 268;  // px: that of A4 landscape without margins, heading, captions
  window.addEventListener('beforeprint', function () {
    document.querySelectorAll('.sensor > .run, #tables > .run, #reading > .run').forEach(function (run) { run.open = true; });
    Array.from(waiting.keys()).forEach(draw);
    document.querySelectorAll('.plot').forEach(function (place) {
      const room = place.closest('.panels') ? width * 2 / 3 : width;
      place.style.zoom = Math.min(0.8, room / place.clientWidth, height / place.clientHeight);
    });
  });
  window.addEventListener('afterprint', function () {
    document.querySelectorAll('.plot').forEach(function (place) { place.style.zoom = ''; });
  });
}());
