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

  const documents = Array.from(document.querySelectorAll('script.figure'));
  const waiting = new Map(documents.map(function (element) {
    const item = JSON.parse(element.textContent);
    return [item.target_id, item];
  }));
  const touch = window.matchMedia('(pointer: coarse)').matches;

  function draw(name) {
    const item = waiting.get(name);
    if (item === undefined) {
      return Promise.resolve();
    }
    waiting.delete(name);
    return Bokeh.embed.embed_item(item).then(function (manager) {
      if (touch && manager) {
        calm(manager);
      }
    });
  }

  /* On a touch screen a finger must scroll the page, not draw a zoom box. */
  function calm(manager) {
    for (const view of manager) {
      const figures = view.model.children || [view.model];
      for (const figure of figures) {
        const model = Array.isArray(figure) ? figure[0] : figure;
        if (model.toolbar) {
          model.toolbar.tools.forEach(function (tool) {
            if (tool.type === 'BoxZoomTool' || tool.type === 'PanTool') {
              tool.active = false;
            }
          });
        }
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
  document.querySelectorAll('.plot').forEach(function (place) { near.observe(place); });
  setTimeout(next, 200);
  /* On paper four figures share a page; they keep the shape that they have on the screen. */
  const width = 490, height = 268;  // px: that of A4 landscape without margins, heading, captions
  window.addEventListener('beforeprint', function () {
    Array.from(waiting.keys()).forEach(draw);
    document.querySelectorAll('.plot').forEach(function (place) {
      place.style.zoom = Math.min(0.8, width / place.clientWidth, height / place.clientHeight);
    });
  });
  window.addEventListener('afterprint', function () {
    document.querySelectorAll('.plot').forEach(function (place) { place.style.zoom = ''; });
  });
}());
