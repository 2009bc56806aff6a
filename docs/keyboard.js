// Changes of the theme for keyboards and screen readers: the search has a name, and areas that scroll
// by themselves can be reached.
const reachable = () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "search");
  for (const one of document.querySelectorAll(".md-typeset__scrollwrap, pre > code, math[display]")) {
    if (one.scrollWidth > one.clientWidth) one.tabIndex = 0;
    else one.removeAttribute("tabindex");
  }
};
addEventListener("load", reachable);
addEventListener("resize", reachable);
