// Put before all else into the report that is shown in a frame. From the disk a frame cannot go to its own fragments (Chromium),
// so links within the report are followed here.
addEventListener("click", (event) => {
  const link = event.target instanceof Element ? event.target.closest("a") : null;
  const target = link && (link.getAttribute("href") || "");
  if (!target || !target.startsWith("#") || event.defaultPrevented) return;
  event.preventDefault();
  history.replaceState(null, "", target);
  document.getElementById(decodeURIComponent(target.slice(1)))?.scrollIntoView();
  dispatchEvent(new HashChangeEvent("hashchange"));
});
