// What a keyboard and a screen reader need of the theme: the search has a name, and whatever scrolls
// by itself can be reached.
const reachable = () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "search");
  for (const one of document.querySelectorAll(".md-typeset__scrollwrap, pre > code, math[display]")) {
    if (one.scrollWidth > one.clientWidth) one.tabIndex = 0;
    else one.removeAttribute("tabindex");
  }
};
addEventListener("load", reachable);
addEventListener("resize", reachable);
