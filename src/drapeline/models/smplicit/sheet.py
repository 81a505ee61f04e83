"""proto"""
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import cg

from drapeline.geometry.mesh import Mesh, edges, half_edges, boundary_loops, edge_counts
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.metrics.garment import piece_indices
import time
T={}
class tick:
    def __init__(s,n): s.n=n
    def __enter__(s): s.t=time.process_time()
    def __exit__(s,*a): T[s.n]=T.get(s.n,0)+time.process_time()-s.t

REACH=20.0; RIM=0.02; POWER=2
SMALL_HOLE=.08

def normals_of(v,f):
    c=np.cross(v[f[:,1]]-v[f[:,0]],v[f[:,2]]-v[f[:,0]])
    n=np.stack([np.bincount(f.ravel(),np.repeat(c[:,k],3),len(v)) for k in range(3)],1)
    l=np.linalg.norm(n,axis=1,keepdims=True)
    return n/np.maximum(l,1e-20), l[:,0]

def sides(walls,normals,area,through,outward):
    pairs=edges(walls.faces)
    wall=np.clip(through,0,1)
    w=np.maximum(np.minimum(wall[pairs[:,0]],wall[pairs[:,1]])**POWER,RIM)*REACH**2
    n=len(walls.vertices)
    dot=np.einsum('vi,vi->v',normals,outward)
    a=area/area.mean()
    i=np.concatenate([pairs[:,0],pairs[:,1]]); j=np.concatenate([pairs[:,1],pairs[:,0]])
    W=sp.csr_matrix((np.tile(w,2),(i,j)),(n,n))
    S=sp.diags(a+np.asarray(W.sum(1)).ravel())-W
    S=S.tocsr()
    d=S.diagonal()
    it=[0]
    def cb(x): it[0]+=1
    u,info=cg(S,a*dot,x0=dot,rtol=1e-3,maxiter=1000,M=sp.diags(1/d),callback=cb)
    T['it']=it[0]
    return u

def cut(faces,u,count):
    """faces of positive part; new vertices as (a,b,share of b)"""
    pos=u>0
    k=pos[faces].sum(1)
    whole=faces[k==3]
    one=faces[k==1]; two=faces[k==2]
    def turn(f,want):
        odd=(pos[f]==want).argmax(1)
        return np.take_along_axis(f,(odd[:,None]+np.arange(3))%3,1)
    one,two=turn(one,True),turn(two,False)
    # crossing edges
    cr=np.concatenate([one[:,[0,1]],one[:,[0,2]],two[:,[1,0]],two[:,[2,0]]])
    key,idx=np.unique(cr[:,0].astype(np.int64)*count+cr[:,1],return_inverse=True)
    a,b=key//count,key%count
    share=np.clip(u[a]/(u[a]-u[b]),.05,.95)
    idx=idx+count
    n1,n2=len(one),len(two)
    o1,o2,t1,t2=np.split(idx,np.cumsum([n1,n1,n2]))
    new=np.concatenate([whole,np.stack([one[:,0],o1,o2],1),np.stack([two[:,1],two[:,2],t2],1),np.stack([two[:,1],t2,t1],1)])
    return new,a,b,share

def compact(faces):
    used,c=np.unique(faces,return_inverse=True)
    return used,c.reshape(faces.shape)

def extract_sheet(field,walls,t,outward,fill=True):
    with tick('normals'):
        v=walls.vertices.astype(np.float64); f=walls.faces
        n,area=normals_of(v,f)
    with tick('field'):
        through=field.distances((v-2*t*n).astype(np.float32))
    with tick('sides'):
        u=sides(walls,n,area,through/t,outward)
    with tick('cut'):
        faces,a,b,share=cut(f,u,len(v))
        used,faces=compact(faces)
        def lift(x):
            s=share.reshape(-1,*[1]*(x.ndim-1))
            return np.concatenate([x,(1-s)*x[a]+s*x[b]])[used]
        p,m,th=lift(v),lift(n),lift(through.astype(float))
        m/=np.linalg.norm(m,axis=1,keepdims=True)
        
    with tick('pieces'):
        piece=piece_indices(Mesh(p,faces))
        T['pieces']=piece.max()+1
        keep=piece[faces[:,0]]==0
        used,faces=compact(faces[keep]); p,m,th=p[used],m[used],th[used]
    with tick('loops'):
        loops=boundary_loops(faces)
        small=[l for l in loops if np.linalg.norm(p[l]-p[np.roll(l,1)],axis=1).sum()<SMALL_HOLE]
        T['small']=len(small)
        if fill:
          for l in small:
            c=len(p)
            p=np.concatenate([p,p[l].mean(0)[None]])
            mm=m[l].mean(0); m=np.concatenate([m,mm[None]/max(np.linalg.norm(mm),1e-9)])
            th=np.append(th,t)
            faces=np.concatenate([faces,np.stack([np.roll(l,-1),l,np.full(len(l),c)],1)])
    with tick('field'):
        f0=field.distances(p.astype(np.float32)).astype(float)
    with tick('place'):
        A=averaging_matrix(faces,len(p))
        wt=np.clip((th/t-.7)/.2,0,1)
        off=np.clip((f0+th-2*t)/2,-t/2,t/2)
        num,den=off*wt,wt
        for _ in range(8):
            num=(num+A@num)/2; den=(den+A@den)/2
        off=num/np.maximum(den,1e-3)
        s=f0-off
    edge=np.zeros(len(p),bool)
    for l in boundary_loops(faces): edge[l]=True
    with tick('grad'):
        rim=edge|(th<RIMZONE*t)
        T['grads']=rim.sum()
        d,g=field.gradients(p[rim].astype(np.float32))
        g/=np.maximum(np.linalg.norm(g,axis=1,keepdims=True),1e-9)
        m[rim]=g
        x=p-s[:,None]*m
    raw=x.copy()
    with tick('smooth'):
        A=averaging_matrix(faces,len(p),along_boundaries=True)
        x=smooth(x,A,np.where(edge,.5,0),BPASS)
        zone=edge|rim
        for _ in range(DIL): zone=zone|(A@zone>0)
        x=smooth(x,A,np.where(zone&~edge,.9,0),RIMPASS)
        x=smooth(x,A,np.full(len(x),.5),PASS)
    return dict(x=x,faces=faces,p=p,m=m,off=off,th=th,rim=rim,edge=edge,raw=raw,loops=boundary_loops(faces))
from drapeline.geometry.smoothing import smooth
RIMZONE,RIMPASS,PASS,BPASS,DIL=.8,10,3,10,2
