// Notes when the frame after the page's own header is there has been drawn: the name that is in the document before any
// script is no view.
new MutationObserver((_, observer) => {
  if (document.querySelector("#page header") === null) return;
  observer.disconnect();
  requestAnimationFrame(() => setTimeout(() => (window.firstView = performance.now() / 1000)));
}).observe(document, { childList: true, subtree: true });
