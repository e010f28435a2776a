/* The slider of compare.html, once that is in the page. */
const byId = (name) => document.getElementById(name);

function startCompare() {
  const compare = byId("compare");
  function show(side, layer, label) {
    const picture = byId(byId(side).value), image = compare.querySelector(layer);
    // At 1:1 the file beside this page, where there is one: the picture in the page may be smaller.
    const full = byId("whole-pixels").checked && picture.dataset.full;
    image.onerror = full ? () => { image.onerror = null; image.src = picture.src; } : null;
    image.src = full || picture.src;
    image.alt = picture.alt;
    compare.querySelector(label).textContent = byId(side).selectedOptions[0].textContent;
  }
  function update() {
    show("left", ".over", ".name.left");
    show("right", ".under", ".name.right");
  }
  function zoom() {
    byId("compare-frame").classList.toggle("whole-pixels", byId("whole-pixels").checked);
    update();
  }
  function place() {
    compare.style.setProperty("--at", byId("slider").value + "%");
  }
  byId("left").addEventListener("change", update);
  byId("right").addEventListener("change", update);
  byId("whole-pixels").addEventListener("change", zoom);
  byId("slider").addEventListener("input", place);
  byId("compare-section").hidden = false;
  update();
  place();
}
