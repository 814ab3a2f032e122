export { default } from "./guide";
