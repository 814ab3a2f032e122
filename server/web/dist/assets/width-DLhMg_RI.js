<<<<<<<< HEAD:server/web/dist/assets/width-OLQ5QLfY.js
import{B as e,H as t,W as n}from"./controls-CerrHsVj.js";function r(r){let i=t(null),[a,o]=n(r);return e(()=>{let e=i.current;if(e===null)return;let t=()=>{e.clientWidth>0&&o(e.clientWidth)};t();let n=new ResizeObserver(t);return n.observe(e),()=>n.disconnect()},[]),[i,a]}export{r as t};
========
import{B as e,H as t,W as n}from"./controls-CwMmQyhS.js";function r(r){let i=t(null),[a,o]=n(r);return e(()=>{let e=i.current;if(e===null)return;let t=()=>{e.clientWidth>0&&o(e.clientWidth)};t();let n=new ResizeObserver(t);return n.observe(e),()=>n.disconnect()},[]),[i,a]}export{r as t};
>>>>>>>> parent of f859f42 (Merge further work on evidence):server/web/dist/assets/width-DLhMg_RI.js
