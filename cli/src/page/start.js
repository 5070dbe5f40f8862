// Everything in its place.

async function start() {
  showHead();
  showCosts();
  if (details) {
    details.asset = new Asset(details);
    await details.asset.load();
    joinLights();
    ['relight', 'compare'].forEach((id) => { byId(id).hidden = false; });
    showPanel();
    showSphere();
    showSlider();
    showErrors();
    await showInspector();
  }
  showBudget();
  if (details) {
    const worst = data.budget?.worst_pixels[0];
    const [x, y] = worst ? worst.map((value) => value / details.factor) : [details.width / 2, details.height / 2];
    inspect(x, y);
    const highest = details.lights.reduce((best, light) => (light.direction[2] > best.direction[2] ? light : best));
    choose(highest.index);
  }
  document.documentElement.dataset.ready = 'true';
}

start().catch((error) => {
  byId('verdict').textContent = `This page could not draw itself: ${error.message}`;
  throw error;
});
