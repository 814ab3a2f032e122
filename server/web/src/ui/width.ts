/** How wide an element is, for drawings whose letters must not be stretched. */
import type { RefObject } from "preact";
import { useLayoutEffect, useRef, useState } from "preact/hooks";

/** The element to measure, and its width in CSS pixels; `first` before it is measured. */
export function useWidth<T extends Element>(first: number): [RefObject<T | null>, number] {
  const element = useRef<T>(null);
  const [width, setWidth] = useState(first);
  // Before it is painted: until then it is as wide as `first`, which may be wider than the screen.
  useLayoutEffect(() => {
    const found = element.current;
    if (found === null) return undefined;
    const measure = (): void => {
      if (found.clientWidth > 0) setWidth(found.clientWidth);
    };
    measure();
    const observer = new ResizeObserver(measure);
    observer.observe(found);
    return () => observer.disconnect();
  }, []);
  return [element, width];
}
