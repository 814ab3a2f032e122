/** Path that the service stands below, `/` or `/hilfit/`: there is one page, whose views are told apart behind `#`. */
export const BASE = typeof document === "undefined" ? "/" : new URL(".", document.baseURI).pathname;
