/** Whether something is in sight. */

/** Tell whether an element is in sight, now and whenever that changes; what is not in sight needs no drawing. */
export function whileSeen(element: Element, tell: (seen: boolean) => void): () => void {
  tell(true);
  if (typeof IntersectionObserver === "undefined") return () => undefined;
  let last = true;
  const observer = new IntersectionObserver(
    (entries) => {
      const seen = entries[entries.length - 1]?.isIntersecting ?? true;
      if (seen !== last) tell(seen);
      last = seen;
    },
    { rootMargin: "50px" },
  );
  observer.observe(element);
  return () => observer.disconnect();
}
